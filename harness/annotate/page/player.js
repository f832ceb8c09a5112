// Playing: a frame is followed by the next when its time is over and the next one has come.

const USUAL_HZ = 10;
const SLOWEST = 1 / 16;
const FASTEST = 4;

export class Player {
  constructor(page, rateHz) {
    this.page = page;
    this.rateHz = rateHz || USUAL_HZ;
    this.speed = .5;
    this.run = null;
  }

  get playing() { return this.run !== null; }

  toggle() { if (this.playing) this.stop(); else this.start(); }

  stop() {
    this.run = null;
    document.body.classList.remove("playing");
  }

  faster(by) { this.speed = Math.min(Math.max(this.speed * by, SLOWEST), FASTEST); }

  async start() {
    const { page } = this;
    const run = this.run = {};
    document.body.classList.add("playing");
    if (page.wanted === page.total - 1) await page.go(0);
    while (this.run === run && page.wanted < page.total - 1) {
      await new Promise((over) => { setTimeout(over, 1000 / (this.rateHz * this.speed)); });
      if (this.run === run) await page.go(page.wanted + 1, true);
    }
    if (this.run === run) this.stop();
  }
}
