"""Path families: how few parameters become an input history."""
