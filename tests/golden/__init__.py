"""Golden traces: runs of which every bit is kept."""
