"""The main job: analyse, design, select, validate and, where asked, fly; in that order."""
