"""`python -m planfit`: the same as the command `planfit`."""

from planfit.cli import main

if __name__ == "__main__":
    main()
