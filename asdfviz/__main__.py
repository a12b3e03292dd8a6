"""`python -m asdfviz`: the command line."""

from __future__ import annotations

from asdfviz.cli import main

if __name__ == "__main__":
    main()
