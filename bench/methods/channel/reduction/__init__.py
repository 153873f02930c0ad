"""From acquisitions to the findings of a channel."""
