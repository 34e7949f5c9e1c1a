"""The fast path of the soft scheme: one array a quantity, and one crowd on several threads."""
