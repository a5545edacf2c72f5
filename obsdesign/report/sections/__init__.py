"""One section of the page, one file: its sentences, tables and captions."""
