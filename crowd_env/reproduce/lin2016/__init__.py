"""The figures of Lin, Ma, Lo 2016."""
