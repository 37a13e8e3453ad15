// The size of a pixel: a browser does not know it, a bank card does.

const CARD = 0.0856; // m, ISO/IEC 7810 ID-1
const KEY = "bunraku.metres";
const CSS_PIXEL = 0.0254 / 96; // m, what CSS takes a pixel for

/** Metres of a CSS pixel on this screen, and whether that was measured. */
export class Calibration {
  /** @param {Storage} store */
  constructor(store) {
    this.store = store;
    const kept = Number(store.getItem(KEY));
    this.known = kept > 1e-5 && kept < 1e-2;
    this.metres = this.known ? kept : CSS_PIXEL;
  }

  /** A card is so many pixels wide. @param {number} pixels */
  card(pixels) {
    this.metres = CARD / pixels;
    this.known = true;
    this.store.setItem(KEY, String(this.metres));
  }

  forget() {
    this.store.removeItem(KEY);
    this.metres = CSS_PIXEL;
    this.known = false;
  }

  /** How wide a card is now, in pixels. */
  get pixels() {
    return CARD / this.metres;
  }

  /** Width and height of the picture in metres; null where that was not measured. @param {{width: number, height: number}} picture */
  size(picture) {
    return this.known ? [picture.width * this.metres, picture.height * this.metres] : null;
  }
}
