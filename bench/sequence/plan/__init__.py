"""The plan of a sequence: its steps in order, loops unrolled, subsequences inserted; poses and motion on the way."""
