"""Floor plans from other programs, read into one form: `read_plan` distinguishes the kinds of files."""
