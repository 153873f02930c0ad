"""Recognition of an unknown instrument by queries that change nothing."""
