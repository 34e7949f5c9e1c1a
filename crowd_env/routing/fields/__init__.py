"""Travel-time fields by fast marching, and how directions are read off them."""
