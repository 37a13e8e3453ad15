// The panels under the stage: a pen's settings, and hands made of sliders and a selection plane.

import {byId, make} from "./dom.js";
import {clamp} from "./maths.js";
import {fingerKey, FINGERS} from "./hands.js";

/** @typedef {import("./hands.js").SliderHands} SliderHands */
/** @typedef {import("./mouse.js").MousePen} MousePen */

const SHOWN = {left: [1, 2, 3], right: [1, 2, 3, 0, 4]}; // fingers with a slider, the most used first
const STEP = 0.1; // of the plane for an arrow key

/** Sliders that show and set the pen that a mouse or a finger stands for. @param {MousePen} pen */
export function penPanel(pen) {
  const pressure = byId("pressure", HTMLInputElement), altitude = byId("altitude", HTMLInputElement);
  const azimuth = byId("azimuth", HTMLInputElement);
  pressure.oninput = () => { pen.pressure = Number(pressure.value); };
  altitude.oninput = () => { pen.altitude = (Number(altitude.value) * Math.PI) / 180; };
  azimuth.oninput = () => { pen.azimuth = (Number(azimuth.value) * Math.PI) / 180; };
  return () => {
    pressure.value = String(pen.pressure);
    altitude.value = String(Math.round((pen.altitude * 180) / Math.PI));
    azimuth.value = String(Math.round((pen.azimuth * 180) / Math.PI) % 360);
  };
}

/**
 * One slider of a hand.
 * @param {string} name @param {string} label @param {(value: number) => void} set
 */
function slider(name, label, set) {
  const input = make("input", {type: "range", min: "-1", max: "1", step: "0.01", value: "0", ariaLabel: label});
  input.oninput = () => set(Number(input.value));
  input.ondblclick = () => set(0);
  return {input, row: make("label", {}, make("span", {textContent: name}), input)};
}

/**
 * @param {SliderHands} hands
 * @returns {() => void} shows what the hands are now
 */
export function handPanel(hands) {
  /** @type {(() => void)[]} */
  const shows = [];
  for (const side of /** @type {const} */ (["right", "left"])) {
    const box = byId(`${side}hand`, HTMLFieldSetElement);
    /** @param {string} name @param {string} label @param {(v: number) => void} set @param {() => number} get */
    const add = (name, label, set, get) => {
      const {input, row} = slider(name, label, set);
      box.append(row);
      shows.push(() => {
        if (document.activeElement !== input || Math.abs(Number(input.value) - get()) > 0.02) input.value = String(get());
      });
    };
    if (side === "right") {
      ["x", "y", "z"].forEach((name, axis) => add(name, `right hand ${name}`, (v) => hands.move(side, axis, v),
        () => hands.hands[side].position[axis]));
    }
    for (const finger of SHOWN[side]) {
      add(FINGERS[finger], `${side} ${FINGERS[finger]} finger`, (v) => hands.bend(side, finger, v),
        () => hands.hands[side].bend[finger]);
    }
  }
  shows.push(plane(hands));
  const duration = byId("duration", HTMLInputElement), text = byId("durationtext", HTMLOutputElement);
  duration.oninput = () => {
    hands.duration = Number(duration.value);
    text.textContent = `${hands.duration.toFixed(1)} s`;
  };
  byId("perform", HTMLButtonElement).onclick = () => hands.perform();
  byId("relax", HTMLButtonElement).onclick = () => hands.relax();
  return () => shows.forEach((one) => one());
}

/**
 * The selection plane: press or drag chooses, a double click performs.
 * @param {SliderHands} hands
 */
function plane(hands) {
  const area = byId("plane", HTMLElement), dot = byId("planedot", HTMLElement);
  /** @param {PointerEvent} event */
  const choose = (event) => {
    const box = area.getBoundingClientRect();
    hands.move("left", 0, clamp((2 * (event.clientX - box.left)) / box.width - 1, -1, 1));
    hands.move("left", 1, clamp(1 - (2 * (event.clientY - box.top)) / box.height, -1, 1));
  };
  area.addEventListener("pointerdown", (event) => {
    area.setPointerCapture(event.pointerId);
    choose(event);
  });
  area.addEventListener("pointermove", (event) => {
    if (event.buttons & 1) choose(event);
  });
  area.addEventListener("dblclick", () => hands.perform());
  area.addEventListener("keydown", (event) => {
    const [x, y] = hands.hands.left.position;
    /** @type {Record<string, () => void>} */
    const acts = {
      ArrowLeft: () => hands.move("left", 0, x - STEP),
      ArrowRight: () => hands.move("left", 0, x + STEP),
      ArrowUp: () => hands.move("left", 1, y + STEP),
      ArrowDown: () => hands.move("left", 1, y - STEP),
      Enter: () => hands.perform(),
      Space: () => hands.perform(),
    };
    const act = acts[event.code];
    if (!act) return;
    event.preventDefault();
    act();
  });
  return () => {
    const [x, y] = hands.hands.left.position;
    dot.style.left = `${50 + 50 * x}%`;
    dot.style.top = `${50 - 50 * y}%`;
    dot.classList.toggle("performing", hands.performing !== null);
  };
}

/**
 * Fingers by the keys 1 to 0; with Shift they stretch.
 * @param {SliderHands} hands @param {() => boolean} active
 */
export function fingerKeys(hands, active) {
  /** @param {KeyboardEvent} event @param {boolean} down */
  const key = (event, down) => {
    const found = fingerKey(event.code);
    if (!found || event.repeat || event.ctrlKey || event.metaKey || event.altKey) return;
    if (down && !active()) return;
    hands.key(found.side, found.finger, down ? (event.shiftKey ? -1 : 1) : null);
  };
  addEventListener("keydown", (event) => key(event, true));
  addEventListener("keyup", (event) => {
    if (hands.keys.size) key(event, false);
  });
}
