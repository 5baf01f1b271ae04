// What the controls offer, and what they are at first.

/** Speeds as shares of real time, by what a link calls them. A slot is 1 ms. */
export const SPEEDS = new Map(["1/1000", "1/500", "1/200", "1/100", "1/50", "1/20", "1/10", "1/5", "1/2", "1", "2", "5"].map((name) => {
  const [slots, milliseconds = 1] = name.split("/").map(Number);
  return [name, slots / milliseconds];
}));

/** A speed in words. */
export const speedWords = (name) => (name === "1" ? "real time" : name.includes("/") ? `${name} of real time` : `${name} × real time`);

// Of the street's numbers (host-sim/presets/street.toml), one thing at a time and all of them.
const STANDING = ["mobility.standing_share=0.3", "fading.follows_speed=true"];
const OLD_GAINS = ["fading.follows_speed=true", "knowledge.gain_delay_slots=4", "knowledge.gain_error_db=2"];
const LATE = ["feedback.acknowledgement_delay_slots=4", "broadcast.call_delay_slots=4"];
const LOST = ["feedback.acknowledgement_loss=0.05", "feedback.broadcast_loss=0.05", "feedback.grant_loss=0.05"];

/** What may be less than perfect: its words, and the scenario's keys that say so. */
export const IMPERFECTIONS = {
  none: { words: "none", settings: [] },
  standing: { words: "30 % of vehicles stand", settings: STANDING },
  gains: { words: "gains 4 ms old, 2 dB off", settings: OLD_GAINS },
  late: { words: "acknowledgements, calls 4 ms late", settings: LATE },
  lost: { words: "5 % of feedback lost", settings: LOST },
  places: { words: "20 % got no place", settings: ["feedback.place_loss=0.2"] },
  weak: { words: "5.9 GHz and 23 dBm", settings: ["radio.carrier_ghz=5.9", "radio.max_power_dbm=23"] },
  street: { words: "a street: the first four", settings: ["mobility.turns=per-crossing", ...new Set([...STANDING, ...OLD_GAINS, ...LATE, ...LOST])] },
};

/** The controls by name, each as the text that a link has. No `until`: without end. */
export const DEFAULTS = {
  policy: "actor", beside: "aloha", vehicles: "20", "c-min": "3", imperfections: "none", seed: "1", speed: "1/20",
  until: "", step: "0", keys: "on",
};
