// The loudness of the clip's sound, as a row of a timeline.

export class Wave {
  constructor(times) {
    this.times = times;
    this.row = document.createElement("div");
    this.row.className = "row wave";
    this.canvas = document.createElement("canvas");
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", "loudness of the sound");
    const room = document.createElement("div");
    room.append(this.canvas);
    this.row.append(Object.assign(document.createElement("span"), { textContent: "sound" }), room);
  }

  draw(sound, first, count) {
    const [width, height] = [this.canvas.parentNode.clientWidth, this.canvas.parentNode.clientHeight];
    const shows = `${first} ${count} ${width}`;
    if (shows === this.shows || !width) return;
    this.shows = shows;
    Object.assign(this.canvas, { width, height });
    const pen = this.canvas.getContext("2d");
    pen.fillStyle = getComputedStyle(this.row).color;
    const last = Math.min(first + count, this.times.length) - 1;
    const stepS = last > first ? (this.times[last] - this.times[first]) / (last - first) : 0;
    const binOf = (x) => Math.floor((this.times[first] + x / width * count * stepS) / sound.bin_s);
    for (let x = 0; x < width; x += 1) {
      const part = sound.loudness.slice(binOf(x), Math.max(binOf(x + 1), binOf(x) + 1));
      const tall = part.length ? Math.max(...part) / 100 * height : 0;
      pen.fillRect(x, (height - tall) / 2, 1, Math.max(tall, 1));
    }
  }
}
