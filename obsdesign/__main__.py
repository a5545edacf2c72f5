"""`python -m obsdesign`."""

from obsdesign.cli import main

if __name__ == "__main__":
    main()
