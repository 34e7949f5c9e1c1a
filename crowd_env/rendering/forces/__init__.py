"""Contact forces as pictures."""
