"""Common part of current sources with SCPI."""
