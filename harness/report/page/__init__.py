"""The report page: one file that opens from disk and makes no network requests.

Data flows one way. ``data.py`` makes one data object from a scored run, ``packing.py`` compresses its large parts,
``render.py`` writes both into the page, and the JavaScript modules draw: ``store.js`` reads, ``main.js`` starts.
"""
