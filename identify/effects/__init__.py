"""One physical effect a file. Whatever class is here with a `name` is in the catalogue."""
