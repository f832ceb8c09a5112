"""MCAP files: their records, their messages, and files that still grow. ``recordings`` interprets the messages."""
