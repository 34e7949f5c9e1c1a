"""How the figures of Lin, Ma, Lo 2016 are drawn."""
