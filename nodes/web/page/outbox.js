// One message for each animation frame and kind: gathers what the hands did and hands it to the connection.

const HEARTBEAT = 250; // ms: what is held is told again, so that the stage knows that the page is alive

/**
 * @typedef {{contacts: import("./touch.js").Contacts, samples: import("./pen.js").PenSamples,
 *   hands: import("./hands.js").SliderHands, pads: import("./pad.js").Pads}} Sources
 * @typedef {{time: number, size: number[] | null, handsActive: boolean, pads: readonly (Gamepad | null)[]}} Now
 */

export class Outbox {
  /** @param {Sources} sources @param {(message: object) => boolean} send */
  constructor(sources, send) {
    this.sources = sources;
    this.send = send;
    this.sent = 0;
    /** @type {Record<string, number>} */
    this.told = {};
  }

  /**
   * Send what has happened since the last frame. @param {Now} now
   * @param {boolean} allowed whether this page plays; if not, what happened is forgotten
   */
  flush(now, allowed) {
    const {contacts, samples, hands, pads} = this.sources;
    const touch = contacts.frame(this.due("touch", now.time));
    if (touch) this.tell("touch", now, {contacts: touch}, allowed);
    const pen = samples.frame(this.due("pen", now.time));
    if (pen.length) this.tell("pen", now, {pen}, allowed);
    const hand = now.handsActive ? hands.frame(this.due("hands", now.time)) : null;
    if (hand) this.tell("hands", now, hand, allowed);
    const pad = pads.frame(now.pads, this.due("pad", now.time) && pads.last !== null);
    if (pad) this.tell("pad", now, pad, allowed);
  }

  /** @param {string} kind @param {number} time */
  due(kind, time) {
    return time - (this.told[kind] ?? -Infinity) > HEARTBEAT;
  }

  /** @param {string} kind @param {Now} now @param {object} fields @param {boolean} allowed */
  tell(kind, now, fields, allowed) {
    this.told[kind] = now.time;
    if (!allowed) return;
    if (this.send({t: "input", kind, time: now.time, size_m: now.size, ...fields})) this.sent++;
  }

  /**
   * The connection is there again: what has a place tells it, and what was held was let go.
   * @returns {boolean} whether a finger or a pen held something
   */
  renew() {
    const {contacts, samples, hands} = this.sources;
    const fingers = contacts.lose(), pen = samples.lose();
    hands.changed = true;
    this.told = {};
    return fingers || pen;
  }
}
