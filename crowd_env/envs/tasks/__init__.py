"""Tasks: environments that are fixed once and for all, so that figures of different policies stand side by side."""
