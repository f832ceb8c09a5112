// The form that labels a stretch of frames: the look around a frame, or what is marked in the viewer. The server has it
// at /label (harness/annotate/correction.py); one without labels has none, and then the form stays closed.
"use strict";

function make(tag, attributes, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

/** The frame at which the viewer is, as a text: its state has the cursor as timeline "frame", kind 1 (a sequence), and one time. */
function frameShown() {
  const bytes = window._handle?.viewer_state() ?? [];
  const cursor = [...message(1, new TextEncoder().encode("frame")), ...number(2, 1), 3 * 8 + 2];
  for (let at = 0; at + cursor.length < bytes.length; at += 1) {
    if (cursor.some((byte, k) => bytes[at + k] !== byte)) continue;
    const start = at + cursor.length + 1;
    const time = bytes.subarray(start + 1, start + bytes[start - 1]);
    if (time.findIndex((byte) => byte < 128) < time.length - 1) continue; // two numbers: the range of the recording
    const value = time.reduce((sum, byte, k) => sum | (BigInt(byte & 127) << BigInt(7 * k)), 0n);
    return String(BigInt.asIntN(64, value));
  }
  return null;
}

class LabelForm {
  /** `written()` is called when a label was written. */
  constructor(root, written) {
    this.root = root;
    this.written = written;
    this.subject = make("select", { name: "subject" });
    this.target = make("select", { name: "target", required: "" });
    [this.first, this.last] = ["first", "last"].map((name) => make("input", { name, type: "number", required: "" }));
    this.said = make("output", {});
    const ends = [["From frame", this.first], ["to frame", this.last]].map(([words, input]) => {
      const here = make("button", { type: "button", "aria-label": `${words}: the one shown` }, "shown");
      here.addEventListener("click", () => { input.value = frameShown() ?? input.value; });
      return make("p", {}, make("label", {}, `${words} `, input), here);
    });
    const close = make("button", { type: "button" }, "Cancel");
    close.addEventListener("click", () => this.close());
    root.append(make("label", {}, "Person ", this.subject), make("label", {}, "looks at ", this.target), ...ends,
      make("p", {}, make("button", {}, "Write the label"), " ", close), this.said);
    root.addEventListener("submit", (event) => { event.preventDefault(); this.write(); });
    root.addEventListener("keydown", (event) => { if (event.key === "Escape") this.close(); });
    this.subject.addEventListener("change", () => this.open({ ...this.asked, subject: this.subject.value }));
  }

  /** Open it for the look of a person around a frame, unless it was closed, or opened for another one, meanwhile. */
  async open(asked) {
    this.asked = asked;
    const answer = await fetch(`/label.json?${new URLSearchParams(Object.entries(asked).filter(([, value]) => value !== null && value !== undefined))}`);
    const content = await (answer.ok ? answer.json() : answer.text());
    if (this.asked !== asked) return;
    this.root.hidden = false;
    if (!answer.ok) {
      this.said.value = content;
      return;
    }
    const { subjects, subject, targets, target, first, last } = content;
    const options = (names) => names.map((value) => make("option", { value }, value));
    this.subject.replaceChildren(...options(subjects));
    this.subject.value = subject;
    this.target.replaceChildren(make("option", { value: "" }, "choose"), ...options(targets));
    [this.first.value, this.last.value] = [first, last];
    this.said.value = target === null ? "Not labelled." : `The label now: ${target}, frames ${first} to ${last}.`;
    this.target.focus();
  }

  async write() {
    this.said.value = "Writing, and scoring the run again …";
    const fields = [this.subject, this.target, this.first, this.last].map(({ name, value }) => [name, value]);
    const body = new URLSearchParams([["clip", this.asked.clip], ...fields]);
    const answer = await fetch("/label", { method: "POST", body });
    if (answer.ok) await this.written();
    else this.said.value = await answer.text();
  }

  close() {
    this.asked = null;
    if (this.root.hidden) return;
    this.root.hidden = true;
    document.getElementById("canvas").focus();
  }
}
