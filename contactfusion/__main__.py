"""The command line by `python -m contactfusion`."""

from contactfusion.cli import main

if __name__ == "__main__":
    main()
