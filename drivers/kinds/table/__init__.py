"""Common part of rate tables: `Table` decides, a dialect translates it into messages."""
