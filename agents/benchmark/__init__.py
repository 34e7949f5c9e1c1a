"""Algorithms beside each other: every one learns every task with several seeds, and what came out is summed up."""
