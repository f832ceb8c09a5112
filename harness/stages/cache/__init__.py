"""The stage cache: stores outputs of perception under everything that they depend on, so that none is computed twice.

``identity.py`` describes what an output depends on, ``values.py`` converts it to bytes exactly, ``store.py`` keeps the
files, and ``stage.py`` looks for stored outputs. Only stages that use nothing but their arguments are cached; a stage
that reads the clip's ground truth or files of its own is as fast as the cache.
"""
