// What this page measures of itself: delay from the hand to the drawn picture, frames, script time, bytes.

/** The last so many numbers, and their percentiles. */
export class Samples {
  /** @param {number} [size] */
  constructor(size = 600) {
    this.size = size;
    /** @type {number[]} */
    this.values = [];
    this.next = 0;
  }

  /** @param {number} value */
  add(value) {
    if (this.values.length < this.size) this.values.push(value);
    else this.values[this.next] = value;
    this.next = (this.next + 1) % this.size;
  }

  /** @param {number} share 0..1 */
  percentile(share) {
    if (!this.values.length) return NaN;
    const sorted = [...this.values].sort((a, b) => a - b);
    return sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))];
  }

  clear() {
    this.values = [];
    this.next = 0;
  }
}

/** @param {number} value @param {number} [digits] */
export const show = (value, digits = 0) => (Number.isFinite(value) ? value.toFixed(digits) : "–");

export class Stats {
  constructor() {
    this.delay = new Samples();
    this.script = new Samples();
    this.gaps = new Samples();
    this.calls = 0;
    this.frames = 0;
    this.last = 0;
    this.lastEcho = NaN;
    this.bytesAt = {bytes: 0, time: 0};
    this.bytesPerSecond = 0;
  }

  /**
   * A frame was drawn. @param {number} began ms @param {number} ended ms @param {number} calls
   * @param {number} echo this page's time of the input that the drawn pose stems from, or NaN
   */
  frame(began, ended, calls, echo) {
    this.frames++;
    if (this.last) this.gaps.add(began - this.last);
    this.last = began;
    this.script.add(ended - began);
    this.calls = calls;
    if (Number.isFinite(echo) && echo !== this.lastEcho) {
      this.lastEcho = echo;
      this.delay.add(ended - echo);
    }
  }

  /** @param {number} bytes received in all @param {number} now ms */
  traffic(bytes, now) {
    const dt = now - this.bytesAt.time;
    if (dt < 900) return;
    this.bytesPerSecond = ((bytes - this.bytesAt.bytes) / dt) * 1000;
    this.bytesAt = {bytes, time: now};
  }

  get rate() {
    return 1000 / this.gaps.percentile(0.5);
  }
}
