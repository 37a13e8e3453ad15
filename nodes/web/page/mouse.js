// The mouse in a finger's or a pen's place: pins as further fingers, the wheel for pressure and tilt.

import {clamp} from "./maths.js";
import {shareOf} from "./view.js";

/** @typedef {import("./touch.js").Contacts} Contacts */
/** @typedef {import("./pen.js").PenSamples} PenSamples */

const NEAR = 0.03; // share of the picture's height within which a pin is taken
const MOVED = 0.008;
const FINGER = {major: 0.0105, minor: 0.0085}; // m, a finger that touches lightly
const PRESSED = 0.009; // m that full pressure adds to both axes

/**
 * Fingers by mouse: press and drag is one finger; with Shift the finger stays when the button is let go; a pin is
 * dragged again by pressing on it and taken away by a Shift-click on it, or all of them by Escape.
 */
export class MouseFingers {
  /** @param {Contacts} contacts */
  constructor(contacts) {
    this.contacts = contacts;
    /** @type {Map<string, {x: number, y: number}>} */
    this.pins = new Map();
    /** @type {{key: string, pinned: boolean, remove: boolean, from: {x: number, y: number}} | null} */
    this.held = null;
    this.pressure = 0.4;
    this.next = 0;
  }

  /** @param {{x: number, y: number}} at @param {number} aspect @param {boolean} shift */
  down(at, aspect, shift) {
    let key = "", best = NEAR;
    for (const [name, pin] of this.pins) {
      const distance = Math.hypot((pin.x - at.x) * aspect, pin.y - at.y);
      if (distance < best) [key, best] = [name, distance];
    }
    const remove = shift && key !== "";
    if (!key) key = `m${this.next++}`;
    this.held = {key, pinned: shift || this.pins.has(key), remove, from: at};
    this.move(at, aspect);
  }

  /** @param {{x: number, y: number}} at @param {number} aspect */
  move(at, aspect) {
    if (!this.held) return;
    const {from, key} = this.held;
    if (Math.hypot((at.x - from.x) * aspect, at.y - from.y) > MOVED) this.held.remove = false;
    if (this.held.pinned) this.pins.set(key, at);
    this.put(key, at);
  }

  up() {
    if (!this.held) return;
    const {key, pinned, remove} = this.held;
    if (!pinned || remove) {
      this.pins.delete(key);
      this.contacts.end(key, "up");
    }
    this.held = null;
  }

  /** All pins and the held finger leave. */
  release() {
    this.held = null;
    this.pins.clear();
    this.contacts.endAll("up", "m");
  }

  /** @param {number} notches of the wheel */
  wheel(notches) {
    this.pressure = clamp(this.pressure - 0.05 * notches, 0, 1);
    if (this.held) this.put(this.held.key, this.at ?? this.held.from);
  }

  /** @param {string} key @param {{x: number, y: number}} at */
  put(key, at) {
    this.at = at;
    const more = PRESSED * this.pressure;
    this.contacts.put(key, {
      ...at, major: FINGER.major + more, minor: FINGER.minor + more, angle: -Math.PI / 2.2, pressure: this.pressure,
    });
  }
}

/** A pen by mouse: hovers, touches while a button is down; its pressure and tilt are set by wheel or sliders. */
export class MousePen {
  /** @param {PenSamples} samples */
  constructor(samples) {
    this.samples = samples;
    this.pressure = 0.5;
    this.altitude = Math.PI / 2;
    this.azimuth = Math.PI / 2;
    /** @type {{x: number, y: number} | null} */
    this.at = null;
    this.contact = false;
    this.buttons = 0;
  }

  /** @param {{x: number, y: number}} at @param {number} buttons as PointerEvents give @param {number} time */
  put(at, buttons, time) {
    this.at = at;
    this.buttons = buttons;
    this.samples.add({
      time, in_range: true, contact: (buttons & 1) !== 0, x: at.x, y: at.y,
      pressure: buttons & 1 ? this.pressure : 0, altitude: this.altitude, azimuth: this.azimuth, twist: null,
      buttons: buttons & 31, eraser: false,
    });
  }

  /** @param {number} time */
  leave(time) {
    this.at = null;
    this.samples.leave(time);
  }

  /**
   * @param {number} notches @param {"pressure" | "altitude" | "azimuth"} what @param {number} time
   */
  wheel(notches, what, time) {
    if (what === "pressure") this.pressure = clamp(this.pressure - 0.05 * notches, 0.05, 1);
    if (what === "altitude") this.altitude = clamp(this.altitude - (Math.PI / 36) * notches, Math.PI / 9, Math.PI / 2);
    if (what === "azimuth") {
      this.azimuth = (this.azimuth + (Math.PI / 12) * notches + 2 * Math.PI) % (2 * Math.PI);
    }
    if (this.at) this.put(this.at, this.buttons, time);
  }
}

/**
 * Hear the mouse on the stage.
 * @param {HTMLElement} element @param {import("./touch.js").Surface} surface
 * @param {{way(): string, fingers: MouseFingers, pen: MousePen, hand: {drag(dx: number, dy: number): void,
 *   lift(notches: number): void}, changed(): void}} act `changed`: a setting moved by the wheel
 */
export function listenMouse(element, surface, act) {
  /** @type {{x: number, y: number} | null} */
  let hand = null;
  /** @param {PointerEvent} event */
  const where = (event) => {
    const picture = surface.picture(), {x, y} = shareOf(picture, event.clientX, event.clientY);
    return {at: {x: clamp(x, -4, 5), y: clamp(y, -4, 5)}, aspect: picture.width / picture.height};
  };
  /** @param {string} type @param {(event: PointerEvent) => void} run */
  const on = (type, run) => element.addEventListener(type, (event) => {
    if (/** @type {PointerEvent} */ (event).pointerType !== "mouse") return;
    run(/** @type {PointerEvent} */ (event));
  });
  on("pointerdown", (event) => {
    element.setPointerCapture(event.pointerId);
    element.focus({preventScroll: true});
    event.preventDefault();
    const {at, aspect} = where(event);
    if (act.way() === "pen") act.pen.put(at, event.buttons, event.timeStamp);
    else if (act.way() === "hands") hand = at;
    else if (event.button === 0) act.fingers.down(at, aspect, event.shiftKey);
  });
  on("pointermove", (event) => {
    const {at, aspect} = where(event);
    if (act.way() === "pen") act.pen.put(at, event.buttons, event.timeStamp);
    else if (hand) {
      act.hand.drag((at.x - hand.x) * aspect, at.y - hand.y);
      hand = at;
    } else act.fingers.move(at, aspect);
  });
  const up = (/** @type {PointerEvent} */ event) => {
    hand = null;
    if (act.way() === "pen") act.pen.put(where(event).at, event.buttons, event.timeStamp);
    act.fingers.up();
  };
  on("pointerup", up);
  on("pointercancel", up);
  on("pointerleave", (event) => act.pen.leave(event.timeStamp));
  element.addEventListener("contextmenu", (event) => event.preventDefault());
  element.addEventListener("wheel", (event) => {
    if (event.ctrlKey) return; // the browser's own zoom
    event.preventDefault();
    const amount = event.deltaY || event.deltaX, notches = Math.sign(amount) * Math.min(3, Math.abs(amount) / 100 || 1);
    if (act.way() === "pen") {
      act.pen.wheel(notches, event.altKey ? "azimuth" : event.shiftKey ? "altitude" : "pressure", event.timeStamp);
    } else if (act.way() === "hands") act.hand.lift(-0.1 * notches);
    else act.fingers.wheel(notches);
    act.changed();
  }, {passive: false});
}
