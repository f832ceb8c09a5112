// The page of one recording: a stretch of its frames can be labelled where the server has labels.
"use strict";

const opens = document.getElementById("opens");
const labelForm = new LabelForm(document.getElementById("label"), () => location.reload()); // with its new content
const where = () => ({ clip: asked.get("clip"), subject: asked.get("subject"), frame: frameShown() ?? asked.get("frame") });

opens.addEventListener("click", () => labelForm.open(where()).catch(complain));
if (asked.has("clip")) {
  fetch(`/label.json?${new URLSearchParams({ clip: asked.get("clip") })}`).then((answer) => { opens.hidden = !answer.ok; });
}
