"""What a person needs before a run begins: sequences and their released versions, check, preflight and plan."""
