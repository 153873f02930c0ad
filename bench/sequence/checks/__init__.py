"""The checks of a sequence: single steps, then rules on the whole plan."""
