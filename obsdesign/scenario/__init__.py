"""TOML -> a typed study; the only place where a string chooses a class."""
