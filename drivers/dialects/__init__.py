"""One package for each instrument or controller family."""
