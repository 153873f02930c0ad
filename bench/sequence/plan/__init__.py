"""A plan: the steps of a sequence in order, with loops unrolled and subsequences inserted; poses and motion on the way."""
