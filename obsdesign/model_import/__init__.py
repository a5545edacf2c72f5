"""Models in the files of other tools: what they say, as the table [system] of a scenario."""
