"""What rate tables have in common: a dialect tells how an axis is spoken to, `Table` decides."""
