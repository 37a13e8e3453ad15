// The pen: every coalesced sample with pressure, tilt, twist and hover.

import {clamp} from "./maths.js";
import {shareOf} from "./view.js";

/**
 * @typedef {{time: number, in_range: boolean, contact: boolean, x: number, y: number, pressure: number,
 *   altitude: number, azimuth: number, twist: number | null, buttons: number, eraser: boolean}} PenSample
 */

const TURN = 2 * Math.PI, UPRIGHT = Math.PI / 2;

/**
 * Tilt of a pen (degrees about y and x, as PointerEvents give) as altitude and azimuth (rad): W3C Pointer Events 3,
 * section "Converting between tiltX / tiltY and altitudeAngle / azimuthAngle".
 * @param {number} tiltX @param {number} tiltY
 */
export function fromTilt(tiltX, tiltY) {
  const x = (tiltX * Math.PI) / 180, y = (tiltY * Math.PI) / 180;
  if (tiltX === 0 && tiltY === 0) return {altitude: UPRIGHT, azimuth: 0};
  if (Math.abs(tiltX) === 90 || Math.abs(tiltY) === 90) {
    const azimuth = tiltX === 0 ? (tiltY > 0 ? UPRIGHT : 3 * UPRIGHT) : tiltY === 0 && tiltX < 0 ? Math.PI : 0;
    return {altitude: 0, azimuth};
  }
  const tx = Math.tan(x), ty = Math.tan(y);
  return {altitude: Math.atan(1 / Math.hypot(tx, ty)), azimuth: (Math.atan2(ty, tx) + TURN) % TURN};
}

/**
 * @param {{clientX: number, clientY: number, pressure: number, buttons: number, timeStamp: number, tiltX?: number,
 *   tiltY?: number, twist?: number, altitudeAngle?: number, azimuthAngle?: number}} event
 * @param {import("./view.js").Rect} picture @param {boolean} twists whether this pen was seen to twist
 * @returns {PenSample}
 */
export function penSample(event, picture, twists) {
  const tilt = fromTilt(event.tiltX ?? 0, event.tiltY ?? 0);
  const known = Number.isFinite(event.altitudeAngle) && Number.isFinite(event.azimuthAngle);
  const altitude = known ? Number(event.altitudeAngle) : tilt.altitude;
  const azimuth = known ? Number(event.azimuthAngle) : tilt.azimuth;
  const eraser = (event.buttons & 32) !== 0;
  const contact = (event.buttons & 1) !== 0 || eraser;
  const {x, y} = shareOf(picture, event.clientX, event.clientY);
  return {
    time: event.timeStamp,
    in_range: true,
    contact,
    x: clamp(x, -4, 5),
    y: clamp(y, -4, 5),
    pressure: contact ? clamp(event.pressure, 0, 1) : 0,
    altitude: clamp(altitude, 0, UPRIGHT),
    azimuth: clamp(((azimuth % TURN) + TURN) % TURN, 0, TURN),
    twist: twists ? clamp(((event.twist ?? 0) * Math.PI) / 180, 0, TURN) : null,
    buttons: event.buttons & 31,
    eraser,
  };
}

/** The same place without touching it. @param {PenSample} sample @returns {PenSample} */
const lifted = (sample) => ({...sample, contact: false, pressure: 0, buttons: 0, eraser: false});

const MOST = 200; // samples of one frame

/** Gathers the pen's samples between two frames. */
export class PenSamples {
  constructor() {
    /** @type {PenSample[]} */
    this.waiting = [];
    /** @type {PenSample | null} */
    this.last = null;
    /** The stroke is over though the pen still touches. */
    this.over = false;
  }

  /** @param {PenSample} sample */
  add(sample) {
    if (!sample.contact) this.over = false;
    if (this.over) sample = lifted(sample);
    if (this.waiting.length >= MOST) this.waiting.splice(0, MOST / 2); // a page that was held up
    this.waiting.push(sample);
    this.last = sample;
  }

  /** The pen has left the range: said once. @param {number} time */
  leave(time) {
    if (!this.last?.in_range) return;
    this.add({...this.last, time, in_range: false, contact: false, pressure: 0, buttons: 0});
  }

  /**
   * The stage has lost the pen: its place is told again, and a stroke goes on only from where it is put down again.
   * @returns {boolean} whether it was drawing
   */
  lose() {
    const last = this.last?.in_range ? this.last : null, drew = last?.contact ?? false;
    this.over ||= drew;
    if (last && drew) this.last = lifted(last);
    this.waiting = this.last?.in_range ? [this.last] : [];
    return drew;
  }

  /**
   * @param {boolean} [again] tell the last sample again while the pen is in contact
   * @returns {PenSample[]}
   */
  frame(again = false) {
    const out = this.waiting;
    this.waiting = [];
    if (!out.length && again && this.last?.contact) return [this.last];
    return out;
  }
}

/**
 * Hear the pen on an element.
 * @param {HTMLElement} element @param {PenSamples} samples @param {import("./touch.js").Surface} surface
 * @param {() => void} [seen] a real pen is there
 */
export function listenPen(element, samples, surface, seen = () => {}) {
  let twists = false;
  /** @param {string} type @param {(event: PointerEvent) => void} act */
  const on = (type, act) => element.addEventListener(type, (event) => {
    if (/** @type {PointerEvent} */ (event).pointerType !== "pen") return;
    event.preventDefault();
    act(/** @type {PointerEvent} */ (event));
  });
  /** @param {PointerEvent} event */
  const read = (event) => {
    seen();
    // Only secure contexts have the samples between two frames; elsewhere the frame's own must do.
    const all = event.type === "pointermove" ? event.getCoalescedEvents?.() ?? [] : [];
    for (const one of all.length ? all : [event]) {
      twists ||= (one.twist ?? 0) !== 0;
      samples.add(penSample(one, surface.picture(), twists));
    }
  };
  on("pointerdown", (event) => {
    element.setPointerCapture(event.pointerId);
    read(event);
  });
  on("pointermove", read);
  on("pointerup", read);
  on("pointercancel", (event) => samples.leave(event.timeStamp));
  on("pointerleave", (event) => samples.leave(event.timeStamp));
}
