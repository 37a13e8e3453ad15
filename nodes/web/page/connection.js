// The socket to the stage: says hello, comes back by itself, acknowledges bundles, and carries calls.

import {acknowledge, readBundle} from "./wire.js";

export const VERSION = 1;
const FIRST_WAIT = 250, LONGEST_WAIT = 3000; // ms between two tries
const SILENCE = 4000; // ms without an answer to a ping: the connection is taken for lost
const PING_EVERY = 1000;
const CALL_TIMEOUT = 90000; // ms without an answer or a word of progress

/** Close codes after which trying again is of no use, and what to tell. @type {Record<number, string>} */
export const FINAL = {
  4002: "This page is of another version than the stage. Load it again.",
  4003: "The link is not valid any more. Open the one that the stage prints, or scan its code.",
};

/**
 * How long to wait before the next try.
 * @param {number} tries that failed @param {number} random 0..1
 */
export function waitBefore(tries, random) {
  return Math.min(LONGEST_WAIT, FIRST_WAIT * 1.6 ** tries) * (0.75 + 0.5 * random);
}

/** A name for this page that stays over reloads; the token moves from the link into the session. */
export class Identity {
  /** @param {Storage} store @param {Location} location @param {History} history */
  constructor(store, location, history) {
    this.store = store;
    const token = /^#t=([\w-]{1,128})$/.exec(location.hash)?.[1];
    if (token) {
      store.setItem("bunraku.token", token);
      history.replaceState(null, "", location.pathname + location.search); // not left on a screen that is filmed
    }
    this.token = token ?? store.getItem("bunraku.token") ?? "";
    /** @type {string} */
    this.page = store.getItem("bunraku.page") ?? this.renew();
  }

  /** A new name: another tab has taken this one's. @returns {string} */
  renew() {
    const bytes = new Uint8Array(4);
    globalThis.crypto.getRandomValues(bytes);
    this.page = [...bytes].map((b) => b.toString(16).padStart(2, "0")).join("");
    this.store.setItem("bunraku.page", this.page);
    return this.page;
  }
}

/** @typedef {"connecting" | "open" | "lost" | "refused" | "broken"} State */
/**
 * @typedef {{
 *   state(state: State, text: string): void,
 *   bundle(parts: import("./wire.js").Part[], now: number): void,
 *   message(message: any): void,
 *   welcome(): void,
 * }} Listener
 */

/**
 * @typedef {{done(data: any): void, failed(error: Error): void, progress(what: string, share: number): void,
 *   timer: number}} Waiting
 */

export class Connection {
  /** @param {string} url @param {Identity} identity @param {Listener} listener */
  constructor(url, identity, listener) {
    this.url = url;
    this.identity = identity;
    this.listener = listener;
    this.role = "auto";
    this.figure = "";
    this.tries = 0;
    this.bytes = 0;
    this.roundTrip = NaN;
    this.heard = 0;
    this.open = false;
    this.nextCall = 1;
    /** @type {Map<number, Waiting>} */
    this.calls = new Map();
    /** @type {WebSocket | null} */
    this.socket = null;
    setInterval(() => this.tend(), PING_EVERY);
    this.connect();
  }

  connect() {
    this.listener.state("connecting", "");
    const socket = (this.socket = new WebSocket(this.url));
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.heard = performance.now();
      const {page, token} = this.identity;
      this.send({t: "hello", page, token, role: this.role, figure: this.figure, version: VERSION});
    };
    socket.onmessage = ({data}) => {
      if (this.socket === socket) this.take(data);
    };
    socket.onclose = ({code, reason}) => {
      if (this.socket === socket) this.lost(code, reason);
    };
  }

  /** @param {string | ArrayBuffer} data */
  take(data) {
    const now = (this.heard = performance.now());
    if (typeof data !== "string") {
      this.bytes += data.byteLength;
      const {number, parts} = readBundle(data);
      this.socket?.send(acknowledge(number));
      this.listener.bundle(parts, now);
      return;
    }
    this.bytes += data.length;
    const message = JSON.parse(data);
    if (message.t === "pong") this.roundTrip = now - message.time;
    else if (message.t === "reply") {
      const call = this.calls.get(message.id);
      this.calls.delete(message.id);
      clearTimeout(call?.timer);
      if (message.ok) call?.done(message.data);
      else call?.failed(new Error(message.error));
    } else if (message.t === "progress") {
      const call = this.calls.get(message.id);
      if (!call) return;
      clearTimeout(call.timer);
      call.timer = this.patience(message.id);
      call.progress(message.what, message.share);
    } else {
      if (message.t === "welcome") {
        this.tries = 0;
        this.open = true;
        this.listener.state("open", "");
        this.listener.welcome();
      }
      this.listener.message(message);
    }
  }

  /** @param {number} code @param {string} reason */
  lost(code, reason) {
    this.socket = null;
    this.open = false;
    this.roundTrip = NaN;
    for (const {failed, timer} of this.calls.values()) {
      clearTimeout(timer);
      failed(new Error("the connection was lost"));
    }
    this.calls.clear();
    if (code === 4001) this.identity.renew();
    if (FINAL[code]) {
      this.listener.state("refused", FINAL[code]);
      return;
    }
    this.listener.state("lost", reason);
    setTimeout(() => this.connect(), waitBefore(this.tries++, Math.random()));
  }

  /** Once a second: a ping; a connection that does not answer is given up. */
  tend() {
    if (!this.socket || this.socket.readyState > WebSocket.OPEN) return;
    if (this.open && performance.now() - this.heard > SILENCE) {
      const socket = this.socket;
      this.lost(0, "no answer");
      socket.close();
    } else if (this.open) this.send({t: "ping", time: performance.now()});
  }

  /** @param {object} message @returns {boolean} whether it could be sent */
  send(message) {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }

  /**
   * Ask the stage to do something.
   * @param {string} verb @param {Record<string, unknown>} [args]
   * @param {(what: string, share: number) => void} [progress] hears how far it is, 0..1
   * @returns {Promise<any>}
   */
  call(verb, args = {}, progress = () => {}) {
    const id = this.nextCall++;
    return new Promise((done, failed) => {
      if (!this.open || !this.send({t: "call", id, verb, args})) {
        failed(new Error("there is no connection to the stage"));
        return;
      }
      this.calls.set(id, {done, failed, progress, timer: this.patience(id)});
    });
  }

  /** Give a call up when nothing is heard of it. @param {number} id @returns {number} */
  patience(id) {
    return window.setTimeout(() => {
      const call = this.calls.get(id);
      this.calls.delete(id);
      call?.failed(new Error("the stage did not answer"));
    }, CALL_TIMEOUT);
  }
}
