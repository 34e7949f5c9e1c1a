"""Floor plans that others drew, read into one form: `read_plan` tells the kinds of files apart."""
