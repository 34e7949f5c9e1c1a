"""How things are compiled, cached, handed to kernels and run on threads."""
