"""`python benchmarks/recordings ...`."""

import sys
from pathlib import Path

if __name__ == "__main__":
    # Run as a folder, its inside is on the path; its modules import each other by the package's name.
    sys.path[0] = str(Path(__file__).resolve().parents[1])
    from recordings.command import main

    main()
