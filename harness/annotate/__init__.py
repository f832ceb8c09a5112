"""The labelling page: a server on this machine, for one person and one clip.

marks       the mark of a frame, and its conversion to and from the CSV
edits       a person's actions, as new marks
history     the state as the sum of all changes: undo, redo, revisions
journal     every change is on disk before it is answered
store       the three together with the CSV: checked, never lost, never overwritten unseen
suggestions a run's predictions, and their confidence
scene       outlines, heads and names in a frame
pictures    the views as JPEG
clip_stores the stores of a clip's annotators
targets     new, renamed and deleted targets, written into the manifest
session     all of it for one clip
app         routes
server      the server, on the base of all servers (harness/server/local_server.py)
address     the same port and token after a restart
page/       HTML, CSS and JavaScript, as they are
"""
