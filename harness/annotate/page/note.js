// The form for a note.

const form = document.getElementById("note");
let done = null;

function close() {
  form.hidden = true;
  document.activeElement.blur();
}

form.addEventListener("submit", (event) => {
  event.preventDefault();
  done(form.elements.note.value.trim());
  close();
});
form.querySelector('[value="cancel"]').addEventListener("click", close);

export function askNote(text, then) {
  done = then;
  form.hidden = false;
  form.elements.note.value = text;
  form.elements.note.focus();
}
