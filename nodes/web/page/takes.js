// The timeline: a take's poses looked at and played on this page, while the stage itself goes on.

import {quatMix} from "./maths.js";

/** @typedef {{times: Float64Array, roots: Float32Array, rotations: Int16Array, joints: number}} Track */

/**
 * Reads the poses that nodes/web/takes.py packs.
 * @param {ArrayBuffer} buffer @returns {Track}
 */
export function readTrack(buffer) {
  const view = new DataView(buffer);
  if (view.getUint32(0, true) !== 0x31544b42) throw new TypeError("this is no take");
  const frames = view.getUint32(4, true), joints = view.getUint32(8, true);
  const times = new Float64Array(buffer.slice(12, 12 + 8 * frames)); // copied: the bytes are not aligned for it
  const roots = new Float32Array(buffer, 12 + 8 * frames, 3 * frames);
  const rotations = new Int16Array(buffer, 12 + 20 * frames, 4 * joints * frames);
  return {times, roots, rotations, joints};
}

/** Length of a take, ms. @param {Track} track */
export const lengthOf = (track) => track.times[track.times.length - 1] ?? 0;

/**
 * The pose of a take at a time (ms since its beginning).
 * @param {Track} track @param {number} time
 * @returns {import("./stage.js").TakeFrame}
 */
export function frameAt(track, time) {
  const {times, roots, rotations, joints} = track, last = times.length - 1;
  let low = 0, high = last;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time) low = middle;
    else high = middle;
  }
  if (time >= times[last]) low = high = last;
  const gap = times[high] - times[low];
  const share = gap > 0 && gap < 250 ? Math.min(1, Math.max(0, (time - times[low]) / gap)) : 0;
  const root = new Float32Array(3), turned = new Float32Array(4 * joints);
  for (let k = 0; k < 3; k++) root[k] = roots[3 * low + k] + share * (roots[3 * high + k] - roots[3 * low + k]);
  const a = rotations.subarray(4 * joints * low, 4 * joints * (low + 1));
  const b = rotations.subarray(4 * joints * high, 4 * joints * (high + 1));
  for (let i = 0; i < turned.length; i += 4) quatMix(turned, i, a, b, i, share);
  return {time, root, rotations: turned};
}

/** @param {number} ms */
export function clockText(ms) {
  const tenths = Math.floor(Math.max(0, ms) / 100 + 1e-6);
  return `${Math.floor(tenths / 600)}:${String(Math.floor(tenths / 10) % 60).padStart(2, "0")}.${tenths % 10}`;
}

/** How a take is listed: by the time of day, an older one by its day too. @param {string} name @param {Date} now */
export function takeName(name, now) {
  const [, year, month, day, hour, minute, second] = /take-(\d{4})(\d\d)(\d\d)-(\d\d)(\d\d)(\d\d)/.exec(name) ?? [];
  if (!year) return name;
  const today = Number(year) === now.getFullYear() && Number(month) === now.getMonth() + 1 && Number(day) === now.getDate();
  return today ? `${hour}:${minute}:${second}` : `${year}-${month}-${day} ${hour}:${minute}`;
}

/** Plays a take back and forth; says where it is. */
export class Player {
  constructor() {
    /** @type {Track | null} */
    this.track = null;
    this.time = 0;
    this.playing = false;
  }

  /** @param {Track | null} track */
  load(track) {
    this.track = track;
    this.time = 0;
    this.playing = false;
  }

  toggle() {
    if (!this.track) return;
    if (!this.playing && this.time >= lengthOf(this.track)) this.time = 0;
    this.playing = !this.playing;
  }

  /** @param {number} share 0..1 */
  seek(share) {
    if (this.track) this.time = share * lengthOf(this.track);
  }

  get share() {
    return this.track ? this.time / (lengthOf(this.track) || 1) : 0;
  }

  /** @param {number} dt ms @returns {import("./stage.js").TakeFrame | null} */
  update(dt) {
    if (!this.track) return null;
    if (this.playing) {
      this.time += dt;
      if (this.time >= lengthOf(this.track)) {
        this.time = lengthOf(this.track);
        this.playing = false;
      }
    }
    return frameAt(this.track, this.time);
  }
}
