// The time in the clip while it plays: from the browser's clock, or from the sound if there is any.

const [SLOWEST, FASTEST] = [.25, 4]; // at other speeds, and backwards, there is no sound

export class SystemClock {
  start(timeS, speed) { Object.assign(this, { timeS, speed, since: performance.now() }); }
  stop() {}
  now() { return this.timeS + (performance.now() - this.since) / 1000 * this.speed; }
}

// The sound is the clock, and pictures follow it: a late picture is less noticeable than interrupted sound.
export class SoundClock {
  constructor(audio) {
    this.audio = audio;
    this.system = new SystemClock();
  }

  start(timeS, speed) {
    const { audio, system } = this;
    system.start(timeS, speed);
    this.isHeard = speed >= SLOWEST && speed <= FASTEST && timeS < audio.duration;
    if (!this.isHeard) return audio.pause();
    audio.playbackRate = speed;
    audio.currentTime = timeS;
    return audio.play().catch(() => { this.goOn(timeS); });
  }

  stop() { this.audio.pause(); }

  now() {
    if (this.isHeard && this.audio.ended) this.goOn(this.audio.duration);
    return this.isHeard ? this.audio.currentTime : this.system.now();
  }

  // Without sound: the browser does not play it, or it is shorter than the clip.
  goOn(timeS) {
    this.isHeard = false;
    this.system.start(timeS, this.system.speed);
  }
}
