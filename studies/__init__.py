"""Studies behind the tables and pictures of the docs; not part of the package."""
