"""Records of a station: its database with the audit in it, and their backup."""
