"""One verb of the command line, one file: `VERB` says what it takes, what it does and how it may end."""
