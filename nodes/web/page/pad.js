// Gamepads: axes and buttons, told when they change.

const STEP = 0.004; // of an axis: less is the stick's own noise

/**
 * @param {{axes: readonly number[], buttons: readonly {pressed: boolean}[]}} pad
 */
export function readPad(pad) {
  return {
    axes: pad.axes.slice(0, 32).map((v) => Math.min(1, Math.max(-1, Number.isFinite(v) ? v : 0))),
    buttons: pad.buttons.slice(0, 64).map((b) => b.pressed),
  };
}

/** The first gamepad that moves is the one that plays. */
export class Pads {
  constructor() {
    /** @type {ReturnType<typeof readPad> | null} */
    this.last = null;
  }

  /**
   * @param {readonly (Gamepad | null)[]} pads @param {boolean} [again]
   * @returns {ReturnType<typeof readPad> | null} null where nothing has changed
   */
  frame(pads, again = false) {
    const pad = pads.find((one) => one?.connected);
    if (!pad) return null;
    const now = readPad(pad), last = this.last;
    const same = last !== null && last.axes.length === now.axes.length &&
      now.axes.every((v, i) => Math.abs(v - last.axes[i]) < STEP) &&
      now.buttons.length === last.buttons.length && now.buttons.every((v, i) => v === last.buttons[i]);
    if (same && !again) return null;
    this.last = now;
    return now;
  }
}
