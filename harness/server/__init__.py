"""A web server for one person on one machine."""
