"""Documents that nobody should write, against everything that reads documents."""
