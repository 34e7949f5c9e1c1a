"""Learning algorithms beside each other on one task: several seeds of each, raw results, intervals, and curves."""
