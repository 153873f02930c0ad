"""Plan of a sequence: steps in order, loops unrolled, subsequences inserted; poses and motion in between."""
