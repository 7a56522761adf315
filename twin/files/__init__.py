"""Reading and writing files safely: CSV, TOML, JSON, and folders of results."""
