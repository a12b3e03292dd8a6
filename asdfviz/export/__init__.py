"""One pure writer a format: sequences and truth to the layouts that other tools read."""
