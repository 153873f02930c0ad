"""Common part of indexing heads on a controller: `Head` decides, a dialect translates it into messages."""
