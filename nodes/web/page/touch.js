// Fingers: TouchEvents as whole frames of contacts with their ellipses; the phases of a frame are kept here.

import {shareOf} from "./view.js";

/**
 * @typedef {{x: number, y: number, major: number | null, minor: number | null, angle: number | null,
 *   pressure: number | null}} Finger
 * Shares of the picture, metres, radians clockwise from +x.
 * @typedef {Finger & {id: number, phase: "down" | "move" | "up" | "cancel"}} Contact
 */

/**
 * What all fingers do, gathered between two frames. A finger that comes and goes within one frame is told in two.
 */
export class Contacts {
  constructor() {
    /** @type {Map<string, {id: number, finger: Finger, told: boolean, ended: null | "up" | "cancel",
     *   over: boolean}>} `over`: still down, and of no effect */
    this.live = new Map();
    this.next = 1;
    this.changed = false;
  }

  /** A finger is down, or moves. @param {string} key @param {Finger} finger */
  put(key, finger) {
    let one = this.live.get(key);
    if (one?.ended) { // the same name for another finger, before the first one's end was told
      this.live.set(`${key} ${one.id}`, one);
      one = undefined;
    }
    if (one?.over) return;
    if (one) one.finger = finger;
    else this.live.set(key, {id: this.next++, finger, told: false, ended: null, over: false});
    this.changed = true;
  }

  /** @param {string} key @param {"up" | "cancel"} how */
  end(key, how) {
    const one = this.live.get(key);
    if (!one || one.ended) return;
    if (one.over) {
      this.live.delete(key);
      return;
    }
    one.ended = how;
    this.changed = true;
  }

  /** @param {"up" | "cancel"} how @param {string} [prefix] only keys that begin so */
  endAll(how, prefix = "") {
    for (const key of this.live.keys()) if (key.startsWith(prefix)) this.end(key, how);
  }

  /**
   * The stage has let go of all that is down: these fingers do nothing more, for by now another part may be under
   * them. A finger that comes later is a new one.
   * @returns {boolean} whether any was down
   */
  lose() {
    const any = [...this.live.values()].some((one) => !one.ended);
    for (const [key, one] of this.live) {
      if (one.ended) this.live.delete(key);
      else one.over = true;
    }
    this.changed = false;
    return any;
  }

  /** Whether any finger is down that holds something. */
  get any() {
    for (const one of this.live.values()) if (!one.over) return true;
    return false;
  }

  /**
   * The frame to tell now: all that are down, and those that have just left; null where nothing has changed.
   * @param {boolean} [again] tell it even so
   * @returns {Contact[] | null}
   */
  frame(again = false) {
    if (!this.changed && !(again && this.any)) return null;
    this.changed = false;
    /** @type {Contact[]} */
    const out = [];
    for (const [key, one] of this.live) {
      if (one.over) continue;
      if (!one.told) {
        out.push({id: one.id, phase: "down", ...one.finger});
        one.told = true;
        if (one.ended) this.changed = true;
      } else if (one.ended) {
        out.push({id: one.id, phase: one.ended, ...one.finger});
        this.live.delete(key);
      } else out.push({id: one.id, phase: "move", ...one.finger});
    }
    return out;
  }
}

/**
 * The ellipse of a touch: full axes in metres and the long one's angle.
 * @param {{radiusX?: number, radiusY?: number, rotationAngle?: number}} touch in CSS pixels and degrees
 * @param {number} metres of a CSS pixel
 */
export function ellipse({radiusX = 0, radiusY = 0, rotationAngle = 0}, metres) {
  if (!(radiusX > 0) || !(radiusY > 0)) return {major: null, minor: null, angle: null};
  const turned = radiusY > radiusX;
  let angle = (rotationAngle * Math.PI) / 180 + (turned ? Math.PI / 2 : 0);
  angle = Math.atan2(Math.sin(2 * angle), Math.cos(2 * angle)) / 2; // an axis has no direction: -90..90 degrees
  const major = 2 * Math.max(radiusX, radiusY) * metres, minor = 2 * Math.min(radiusX, radiusY) * metres;
  return {major, minor, angle};
}

/**
 * @typedef {{picture(): import("./view.js").Rect, metres(): number}} Surface
 * The picture's rectangle in the page's pixels, and metres of a CSS pixel.
 */

/** Whether a force has told more than that there is one: devices without a sensor say 0, 0.5 or 1. */
export class Force {
  constructor() {
    /** @type {Set<number>} */
    this.seen = new Set();
  }

  /** @param {number | undefined} force @returns {number | null} */
  read(force) {
    if (typeof force !== "number" || !(force >= 0 && force <= 1)) return null;
    if (this.seen.size < 4) this.seen.add(force);
    return this.seen.size > 2 ? force : null;
  }
}

/**
 * Hear the fingers on an element.
 * @param {HTMLElement} element @param {Contacts} contacts @param {Surface} surface
 * @param {(phase: "down" | "move" | "up" | "cancel", touches: Touch[]) => boolean} [taken] says that another part takes
 *   these touches
 */
export function listenTouch(element, contacts, surface, taken = () => false) {
  const force = new Force();
  /** @param {Touch} touch @returns {Finger} */
  const read = (touch) => ({
    ...shareOf(surface.picture(), touch.clientX, touch.clientY),
    ...ellipse(touch, surface.metres()),
    pressure: force.read(touch.force),
  });
  // A stylus also sends TouchEvents; it is heard as a pen.
  /** @param {TouchEvent} event */
  const fingersOf = (event) => [...event.changedTouches].filter((t) => /** @type {any} */ (t).touchType !== "stylus");
  /** @param {"down" | "move"} phase @returns {(event: TouchEvent) => void} */
  const here = (phase) => (event) => {
    event.preventDefault();
    const changed = fingersOf(event);
    if (taken(phase, changed)) return;
    for (const touch of changed) contacts.put(`t${touch.identifier}`, read(touch));
  };
  /** @param {"up" | "cancel"} how @returns {(event: TouchEvent) => void} */
  const away = (how) => (event) => {
    event.preventDefault();
    const changed = fingersOf(event);
    if (taken(how, changed)) return;
    for (const touch of changed) {
      const key = `t${touch.identifier}`;
      if (contacts.live.has(key) && how === "up") contacts.put(key, read(touch));
      contacts.end(key, how);
    }
  };
  if (hasTouchEvents()) {
    const active = {passive: false};
    element.addEventListener("touchstart", here("down"), active);
    element.addEventListener("touchmove", here("move"), active);
    element.addEventListener("touchend", away("up"), active);
    element.addEventListener("touchcancel", away("cancel"), active);
  } else listenPointers(element, contacts, surface, force);
}

/** @param {{navigator?: {maxTouchPoints: number}}} [scope] */
export function hasTouchEvents(scope = globalThis) {
  return "TouchEvent" in scope && ("ontouchstart" in scope || (scope.navigator?.maxTouchPoints ?? 0) > 0);
}

/**
 * Browsers without TouchEvents: the same from PointerEvents, which know no rotation.
 * @param {HTMLElement} element @param {Contacts} contacts @param {Surface} surface @param {Force} force
 */
function listenPointers(element, contacts, surface, force) {
  /** @param {PointerEvent} event @returns {Finger} */
  const read = (event) => ({
    ...shareOf(surface.picture(), event.clientX, event.clientY),
    ...ellipse({radiusX: event.width / 2, radiusY: event.height / 2}, surface.metres()),
    pressure: force.read(event.pressure),
  });
  /** @param {string} type @param {(event: PointerEvent) => void} act */
  const on = (type, act) => element.addEventListener(type, (event) => {
    if (/** @type {PointerEvent} */ (event).pointerType === "touch") act(/** @type {PointerEvent} */ (event));
  });
  on("pointerdown", (event) => contacts.put(`t${event.pointerId}`, read(event)));
  on("pointermove", (event) => {
    if (contacts.live.has(`t${event.pointerId}`)) contacts.put(`t${event.pointerId}`, read(event));
  });
  on("pointerup", (event) => contacts.end(`t${event.pointerId}`, "up"));
  on("pointercancel", (event) => contacts.end(`t${event.pointerId}`, "cancel"));
}
