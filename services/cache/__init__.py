"""Cache of computed values on disk: what a key is made of, how values become files, and the folder of the files."""
