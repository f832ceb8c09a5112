// The axis of a timeline: frame numbers and clock times; a slider for the keyboard and for screen readers.

const LABEL_PX = 110;
const STEPS = [1, 2, 5];

// Format seconds as 1:02:03.4, with enough digits to distinguish two frames.
export function clock(seconds, stepS = 1) {
  const digits = stepS < .1 ? 2 : stepS < 1 ? 1 : 0;
  const [minutes, rest] = [Math.floor(Math.abs(seconds) / 60), Math.abs(seconds) % 60];
  const text = rest.toFixed(digits).padStart(digits ? digits + 3 : 2, "0");
  const hours = Math.floor(minutes / 60);
  const front = hours ? `${hours}:${String(minutes % 60).padStart(2, "0")}` : minutes;
  return `${seconds < 0 ? "-" : ""}${front}:${text}`;
}

export class Axis {
  constructor(frames, times) {
    Object.assign(this, { frames, times });
    this.stepS = times.length > 1 ? (times[times.length - 1] - times[0]) / (times.length - 1) : 1;
    this.row = document.createElement("div");
    this.row.className = "row axis";
    this.row.append(Object.assign(document.createElement("span"), { textContent: "frame, time" }), document.createElement("div"));
    this.slider = this.row.lastChild;
    for (const [name, value] of Object.entries({ role: "slider", tabindex: 0, "aria-label": "Frame", "aria-valuemin": 1, "aria-valuemax": frames.length })) {
      this.slider.setAttribute(name, value);
    }
  }

  words(position) { return `frame ${this.frames[position]}, ${clock(this.times[position], this.stepS)}`; }

  draw(first, count, position, said) {
    this.slider.setAttribute("aria-valuenow", position + 1);
    this.slider.setAttribute("aria-valuetext", `${this.words(position)}, ${said}`);
    const shows = `${first} ${count} ${this.slider.clientWidth}`;
    if (shows === this.shows) return;
    this.shows = shows;
    const least = count / Math.max(Math.floor(this.slider.clientWidth / LABEL_PX), 1);
    const power = 10 ** Math.floor(Math.log10(Math.max(least, 1)));
    const step = (STEPS.find((each) => each * power >= least) || 10) * power;
    const ticks = [];
    for (let at = Math.ceil(first / step) * step; at < first + count; at += step) {
      const tick = document.createElement("s");
      tick.style.left = `${100 * (at - first) / count}%`;
      tick.append(Object.assign(document.createElement("span"), { textContent: `${this.frames[at]} · ${clock(this.times[at], this.stepS * step)}` }));
      ticks.push(tick);
    }
    this.slider.replaceChildren(...ticks);
  }
}
