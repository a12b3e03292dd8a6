"""Opens the browser app: `python app.py [SEQUENCE] [--port N] [--assembly PATH]`; see `asdfviz view --help`."""

import sys

from asdfviz.cli import main

if __name__ == "__main__":
    main(["view", *sys.argv[1:]])
