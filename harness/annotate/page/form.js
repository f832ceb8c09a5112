// A form that opens below the names, takes the focus, and returns it; Escape and Cancel close it.

export class Form {
  // submit(): it was submitted; the caller closes it.
  constructor(id, submit) {
    this.root = document.getElementById(id);
    this.root.addEventListener("submit", (event) => { event.preventDefault(); submit(); });
    this.root.querySelector('[value="cancel"]').addEventListener("click", () => this.close());
    this.root.addEventListener("keydown", (event) => {
      if (event.key !== "Escape") return;
      event.stopPropagation();
      this.close();
    });
  }

  get values() {
    const entries = [...this.root.elements].filter((each) => each.name).map((each) => [each.name, each.value.trim()]);
    return Object.fromEntries(entries);
  }

  open(values) {
    this.opener = document.activeElement;
    for (const [name, value] of Object.entries(values)) this.root.elements[name].value = value;
    this.root.hidden = false;
    this.root.elements[0].focus();
  }

  close() {
    this.root.hidden = true;
    document.activeElement.blur();
    if (this.opener && this.opener.tagName === "BUTTON") this.opener.focus();
  }
}
