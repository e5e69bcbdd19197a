"""``python -m hystid``."""

from hystid.cli import main

if __name__ == "__main__":
    main()
