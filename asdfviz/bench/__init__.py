"""Speed and accuracy of single rooms on fixed recordings, beside what other programs reach on them."""
