// Palettes by value and colours of sensors.
"use strict";

// stops of palettes that people with any colour vision can read, from low to high
const PALETTES = {
  viridis: ["440154", "482878", "3e4989", "31688e", "26828e", "1f9e89", "35b779", "6ece58", "b5de2b", "fde725"],
  cividis: ["00224e", "123570", "3b496c", "575d6d", "707173", "8a8678", "a59c74", "c3b369", "e1cc55", "fee838"],
  inferno: ["000004", "1b0c41", "4a0c6b", "781c6d", "a52c60", "cf4446", "ed6925", "fb9b06", "f7d13d", "fcffa4"],
  grey: ["202020", "ffffff"],
};
// Okabe and Ito
const SENSOR_COLOURS = ["0072b2", "e69f00", "009e73", "cc79a7", "56b4e9", "d55e00", "f0e442", "999999"];

function rgb(hex) {
  return [0, 2, 4].map((at) => parseInt(hex.slice(at, at + 2), 16) / 255);
}

function paletteBytes(name) {
  const stops = PALETTES[name].map(rgb);
  const bytes = new Uint8Array(256 * 4);
  for (let at = 0; at < 256; at++) {
    const place = (at / 255) * (stops.length - 1);
    const [low, high] = [stops[Math.floor(place)], stops[Math.ceil(place)]];
    const share = place - Math.floor(place);
    for (let channel = 0; channel < 3; channel++) bytes[4 * at + channel] = 255 * (low[channel] * (1 - share) + high[channel] * share);
    bytes[4 * at + 3] = 255;
  }
  return bytes;
}
