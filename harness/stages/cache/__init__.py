"""The stage cache: what perception found is stored by all that it follows from, and never computed twice.

``identity.py`` says what a result follows from, ``values.py`` how it is written to the last bit, ``store.py`` where it
stands, and ``stage.py`` is a stage that looks there first. Only stages that see nothing but their arguments take part;
one that reads the clip's truth or files of its own is as quick as the cache.
"""
