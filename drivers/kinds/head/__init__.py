"""What indexing heads on a controller have in common: a dialect tells how an axis is spoken to, `Head` decides."""
