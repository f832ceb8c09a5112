"""The labelling page: a server on this machine, for one person and one clip.

marks            the marks of frames, and their conversion to and from the CSV
actions          a person's actions, and the marks that they set
journal          an entry a line: every change is on the disk before it is answered
journaled_store  a file that is changed step by step, with undo and redo
label_store      an annotator's labels, so kept
drawing_store    the shapes drawn on a clip, so kept
clip_stores      the stores of a clip's annotators
target_change    new, renamed and deleted targets, written into the manifest, the labels and the drawing
history          labels, targets and drawing with one undo list
suggestions      a run's predictions, their confidence, and the frames to label first
clip_pictures    images as JPEG, outlines and heads
session          all of it for one clip
app              routes and server
last_address     the same port and token after a restart
correction       one label of a served report
convert          labels and a run's predictions in formats of other programs
page/            HTML, CSS and JavaScript, as they are
"""
