// How many pixels to draw: a slow machine gets fewer pixels rather than fewer frames.

const SLOW = 24, FAST = 17.5; // ms between two frames, on average
const SHARES = [1, 0.8, 0.65, 0.5]; // of the screen's pixels along an edge: few, for each change stops the browser
const LEAST = SHARES.length - 1;
const SETTLE = 1000; // ms after a change before the next is thought of
const WAIT = 4000, LONGEST = 120000; // ms before more pixels are tried, doubled each time
const USEFUL = 0.9; // of the time between frames: where the fewest pixels save less than the rest, all are drawn
const PAUSE = 500; // ms: nothing was drawn meanwhile
const MEMORY = 500; // ms over which the time between frames is averaged

/** Chooses the share of the screen's pixels from the time between frames. */
export class Pace {
  level = 0;
  gap = 1000 / 60;
  /** The time between frames when all pixels were drawn last. */
  full = Infinity;
  last = -Infinity;
  changed = -Infinity;
  /** Since when all pixels are too many. */
  slow = Infinity;
  wait = WAIT;
  /** Fewer pixels were of no use. */
  held = false;

  get scale() {
    return SHARES[this.level];
  }

  /** A frame is drawn. @param {number} now ms */
  update(now) {
    const gap = now - this.last, since = now - this.changed;
    this.last = now;
    if (!(gap > 0 && gap < PAUSE)) return;
    this.gap += (gap / MEMORY) * (gap - this.gap);
    if (since > this.wait) this.held = false;
    if (since < SETTLE) return;
    if (this.level === LEAST && since < 2 * SETTLE && this.gap > USEFUL * this.full) {
      this.change(0, now);
      this.held = true;
    } else if (this.gap > SLOW && this.level < LEAST && !this.held) {
      this.slow = Math.min(this.slow, now);
      if (this.level === 0) this.full = this.gap;
      if (now - this.slow > SETTLE) this.change(this.level + 1, now);
    } else if (this.gap < FAST && this.level > 0 && since > this.wait) this.change(this.level - 1, now);
  }

  /** @param {number} level @param {number} now */
  change(level, now) {
    if (level < this.level) this.wait = Math.min(LONGEST, 2 * this.wait);
    this.level = level;
    this.changed = now;
    if (!level) this.slow = Infinity;
  }
}
