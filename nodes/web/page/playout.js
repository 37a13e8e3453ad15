// When to show what arrived: the stage's clock as seen from this page, and samples between two messages.

import {clamp, quatMix} from "./maths.js";

const KEPT = 64;
const MAX_DELAY = 120; // ms
const STALL = 250; // ms between two samples: no gliding over a pause
const SLOW = 20; // ms: a stream with longer intervals is shown one interval late, to be interpolated
const JUMP = 0.5; // m of the root between two samples: shown as a jump

/** Tells the stage's time from this page's: the fastest messages say the offset, the late ones the delay. */
export class Playout {
  offset = Infinity;
  delay = 0;
  interval = 1000 / 60;
  last = -Infinity;
  /** @type {number[]} */
  late = [];

  reset() {
    this.offset = Infinity;
    this.delay = 0;
    this.interval = 1000 / 60;
    this.last = -Infinity;
    this.late.length = 0;
  }

  /**
   * A message sent at `stamp` (ms, the stage's clock) came at `arrival` (ms, this page's clock).
   * @param {number} stamp @param {number} arrival
   */
  heard(stamp, arrival) {
    const shift = arrival - stamp;
    if (stamp < this.last - 1000 || shift > this.offset + 5000) this.reset();
    this.offset = Math.min(this.offset + 0.01, shift); // the creep follows two clocks that drift apart
    const gap = stamp - this.last;
    if (gap > 0 && gap < STALL) this.interval += 0.1 * (gap - this.interval);
    this.last = stamp;
    if (gap > STALL) return; // the first after a pause may be an old one, sent again
    this.late.push(shift - this.offset);
    if (this.late.length > KEPT) this.late.shift();
    const sorted = [...this.late].sort((a, b) => a - b);
    const wanted = sorted[Math.floor(0.9 * (sorted.length - 1))] + (this.interval > SLOW ? this.interval : 0);
    this.delay += 0.1 * (clamp(wanted, 0, MAX_DELAY) - this.delay);
  }

  /**
   * The stage's time to show now.
   * @param {number} now ms, this page's clock
   */
  at(now) {
    return now - this.offset - this.delay;
  }
}

/**
 * The last few samples of a stream, in order of their stamps.
 * @template {{stamp: number}} T
 */
export class Track {
  constructor() {
    /** @type {T[]} */
    this.samples = [];
  }

  /** @returns {T | null} */
  get newest() {
    return this.samples[this.samples.length - 1] ?? null;
  }

  /** @param {T} sample */
  push(sample) {
    const newest = this.newest;
    if (newest && sample.stamp <= newest.stamp) {
      if (sample.stamp > newest.stamp - 1000) return; // the same one again
      this.samples = []; // the stage began again
    }
    this.samples.push(sample);
    if (this.samples.length > 16) this.samples.shift();
  }

  /**
   * The two samples around a time and the share of the second; before the first the first, after the last the last.
   * @param {number} time ms, the stage's clock
   * @returns {{a: T, b: T, share: number} | null}
   */
  around(time) {
    const n = this.samples.length;
    if (!n) return null;
    let i = n - 1;
    while (i > 0 && this.samples[i - 1].stamp > time) i--;
    const b = this.samples[i], a = this.samples[Math.max(0, i - 1)];
    if (a === b || time >= b.stamp || b.stamp - a.stamp > STALL) return {a: b, b, share: 1};
    return {a, b, share: clamp((time - a.stamp) / (b.stamp - a.stamp), 0, 1)};
  }
}

/**
 * A pose between two others; `echo` and `seq` are the later one's.
 * @param {{a: import("./wire.js").Pose, b: import("./wire.js").Pose, share: number}} between
 * @returns {import("./wire.js").Pose}
 */
export function mixPoses({a, b, share}) {
  if (share >= 1 || a === b || a.rotations.length !== b.rotations.length) return b;
  const leap = Math.hypot(b.root[0] - a.root[0], b.root[1] - a.root[1], b.root[2] - a.root[2]);
  if (leap > JUMP) return b;
  const rotations = new Float32Array(b.rotations.length), root = new Float32Array(3);
  for (let k = 0; k < 3; k++) root[k] = a.root[k] + share * (b.root[k] - a.root[k]);
  for (let i = 0; i < rotations.length; i += 4) quatMix(rotations, i, a.rotations, b.rotations, i, share);
  return {...b, stamp: a.stamp + share * (b.stamp - a.stamp), root, rotations};
}

/**
 * @param {{a: import("./wire.js").Camera, b: import("./wire.js").Camera, share: number}} between
 * @returns {import("./wire.js").Camera}
 */
export function mixCameras({a, b, share}) {
  if (share >= 1 || a === b || (a.yfov > 0) !== (b.yfov > 0)) return b;
  const turned = new Float32Array(4);
  quatMix(turned, 0, a.rotation, b.rotation, 0, share);
  /** @param {number} p @param {number} q */
  const mix = (p, q) => p + share * (q - p);
  return {
    stamp: mix(a.stamp, b.stamp),
    position: a.position.map((v, k) => mix(v, b.position[k])),
    rotation: [...turned],
    yfov: mix(a.yfov, b.yfov),
    orthoHeight: mix(a.orthoHeight, b.orthoHeight),
    aspect: b.aspect,
  };
}
