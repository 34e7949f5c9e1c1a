"""Tasks: environments that are fixed once and for all, so that figures of one policy stand beside those of another."""
