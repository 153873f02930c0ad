"""Common logic of all thermal chambers; a dialect translates it into messages."""
