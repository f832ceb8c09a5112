// What is said in words around the picture.

const find = (id) => document.getElementById(id);

export function drawPlace(number, position, total, speed) {
  find("frame").value = number === null ? "Loading the first frame …" : `Frame ${number}, ${position + 1} of ${total}, ×${speed}`;
}

export function drawLabel(subject, { target, suggested, note }) {
  const said = target === null ? "not labelled" : `${target}${suggested ? " (a suggestion)" : ""}`;
  find("label").value = `${subject}: ${said}${note ? ` – ${note}` : ""}`;
}

export function drawSubjects(subjects, current, turnTo) {
  find("subjects").replaceChildren(...subjects.map((name) => {
    const button = Object.assign(document.createElement("button"), { textContent: name });
    button.setAttribute("role", "tab");
    button.setAttribute("aria-selected", name === current);
    button.addEventListener("click", () => turnTo(name));
    return button;
  }));
}

export function drawProgress({ labelled, total, seconds_left: left }) {
  find("bar").value = labelled / total;
  const duration = left < 90 ? `${Math.ceil(left)} s` : `${Math.ceil(left / 60)} min`;
  const time = left === null || labelled === total ? "" : `, about ${duration} left`;
  find("share").textContent = `${labelled} of ${total} labelled (${Math.floor(100 * labelled / total)} %)${time}`;
}
