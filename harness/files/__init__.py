"""Files: read, written, parsed within bounds, digested and cached; the folders that hold them."""
