"""The report page: one file that opens from disk and asks the network for nothing.

Data flows one way. ``data.py`` makes one data object of a scored run, ``packs.py`` compresses its large parts,
``render.py`` writes both into the page, and the JavaScript modules draw: ``store.js`` reads, ``main.js`` starts.
"""
