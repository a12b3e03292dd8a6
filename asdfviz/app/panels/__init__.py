"""The panel's tabs, one file each: a pure function from a snapshot to HTML."""
