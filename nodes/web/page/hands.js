// Hands without a glove: sliders and a selection plane give both hands' samples in normalised units, -1..1.

import {clamp} from "./maths.js";

export const FINGERS = ["thumb", "index", "middle", "ring", "little"];
/** @typedef {"left" | "right"} Side */
/** @typedef {{confidence: number, position: number[], rotation: null, bend: number[]}} Hand */

const SPRING = 6; // 1/s: how fast a finger that a key bends goes there and back
const HOLD = 0.25; // s that a performed action stays at its end
const TINY = 1e-4;

/**
 * Both hands. The left hand's x and y choose in the plane and its z performs: from rest at -1 it jumps to 0, runs to
 * 1 in the time set, stays a moment and comes back.
 */
export class SliderHands {
  constructor() {
    this.hands = {left: blank(-1), right: blank(0)};
    this.duration = 1.0;
    /** @type {number | null} s since an action began */
    this.performing = null;
    /** @type {Map<string, number>} keys that are down: finger to its goal */
    this.keys = new Map();
    this.changed = false;
  }

  /** @param {Side} side @param {number} axis 0..2 @param {number} value */
  move(side, axis, value) {
    this.hands[side].position[axis] = clamp(value, -1, 1);
    this.changed = true;
  }

  /** @param {Side} side @param {number} finger 0..4 @param {number} value */
  bend(side, finger, value) {
    this.hands[side].bend[finger] = clamp(value, -1, 1);
    this.changed = true;
  }

  /** Drag the right hand by shares of the picture's height. @param {number} dx @param {number} dy */
  drag(dx, dy) {
    const [x, y] = this.hands.right.position;
    this.move("right", 0, x + 2 * dx);
    this.move("right", 1, y - 2 * dy);
  }

  /** @param {number} dz */
  lift(dz) {
    this.move("right", 2, this.hands.right.position[2] + dz);
  }

  /** Perform the chosen action. */
  perform() {
    this.performing = 0;
    this.changed = true;
  }

  /** A finger's key goes down, or (goal null) up. @param {Side} side @param {number} finger @param {number | null} goal */
  key(side, finger, goal) {
    this.keys.set(`${side} ${finger}`, goal ?? 0);
    this.changed = true;
  }

  relax() {
    this.hands = {left: blank(-1), right: blank(0)};
    this.performing = null;
    this.keys.clear();
    this.changed = true;
  }

  /** Let time pass. @param {number} dt s */
  update(dt) {
    if (this.performing !== null) {
      this.performing += dt;
      const share = this.performing / this.duration;
      const done = this.performing > this.duration + HOLD;
      this.hands.left.position[2] = done ? -1 : Math.min(1, share);
      if (done) this.performing = null;
      this.changed = true;
    }
    for (const [name, goal] of this.keys) {
      const [side, finger] = name.split(" ");
      const bends = this.hands[/** @type {Side} */ (side)].bend, k = Number(finger);
      const next = goal + (bends[k] - goal) * Math.exp(-SPRING * dt);
      bends[k] = Math.abs(next - goal) < TINY * 10 ? goal : next;
      if (bends[k] === 0 && goal === 0) this.keys.delete(name);
      this.changed = true;
    }
  }

  /** The frame to tell; null where nothing has changed. @param {boolean} again */
  frame(again = false) {
    if (!this.changed && !again) return null;
    this.changed = false;
    /** @param {Hand} hand @returns {Hand} */
    const copy = (hand) => ({...hand, position: [...hand.position], bend: [...hand.bend]});
    return {left: copy(this.hands.left), right: copy(this.hands.right)};
  }
}

/** @param {number} z @returns {Hand} */
function blank(z) {
  return {confidence: 1, position: [0, 0, z], rotation: null, bend: [0, 0, 0, 0, 0]};
}

/**
 * What a key on the keyboard means: 1 to 5 are the right hand's fingers from the thumb, 6 to 0 the left hand's.
 * @param {string} code of the key @returns {{side: Side, finger: number} | null}
 */
export function fingerKey(code) {
  const digit = /^Digit(\d)$/.exec(code)?.[1];
  if (digit === undefined) return null;
  const place = (Number(digit) + 9) % 10;
  return {side: place < 5 ? "right" : "left", finger: place % 5};
}
