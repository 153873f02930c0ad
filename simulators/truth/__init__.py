"""What a perfect bench would find of a simulated unit; shares no line with the reductions."""
