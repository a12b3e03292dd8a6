"""The browser app: one viser server, one session a browser tab. Imported by nobody but the command line."""
