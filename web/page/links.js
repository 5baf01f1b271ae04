// The page's link: every control both ways. #policy=aloha&vehicles=30 is enough; what is not named is as at first.

import { DEFAULTS, IMPERFECTIONS, SPEEDS } from "./choices.js";
import { STEPS } from "./tour.js";

const SEED_MOST = 2n ** 64n - 1n;

const among = (names) => ({ fits: (text) => names.includes(text), expected: `one of ${names.join(", ")}` });
const number = (least, most, step) => ({
  fits: (text) => /^\d+(\.\d+)?$/.test(text) && text >= least && text <= most && (text - least) % step === 0,
  expected: `${step === 1 ? "a whole number" : `a multiple of ${step}`} from ${least} to ${most}`,
});

/** What a link may say, by control. `policies` are their names, `room` is how many vehicles the page holds. */
const checks = ({ policies, room }) => ({
  policy: among(policies),
  beside: among(policies),
  vehicles: number(1, room, 1),
  "c-min": number(1, 6, 0.5),
  imperfections: among(Object.keys(IMPERFECTIONS)),
  seed: { fits: (text) => /^\d+$/.test(text) && BigInt(text) <= SEED_MOST, expected: `a whole number from 0 to ${SEED_MOST}` },
  speed: among([...SPEEDS.keys()]),
  until: number(1, 1e9, 1),
  step: among(Object.keys(STEPS)),
  keys: among(["on", "off"]),
});

/** The controls that a link asks for, and in words what it asks for in vain. */
export function read(hash, about) {
  const checked = checks(about), named = {}, refusals = [];
  for (const [key, text] of new URLSearchParams(hash.replace(/^#/, ""))) {
    const check = Object.hasOwn(checked, key) ? checked[key] : null;
    if (!check) refusals.push(`${key}: found no control of this name, expected one of ${Object.keys(checked).join(", ")}`);
    else if (check.fits(text)) named[key] = text;
    else refusals.push(`${key}: found “${text}”, expected ${check.expected}`);
  }
  return { values: { ...DEFAULTS, ...STEPS[named.step ?? 0].controls, ...named }, refusals };
}

/** The link of these controls: what a visitor most often changes is always there, the rest where it is not as at first. */
export function write(values) {
  const always = ["policy", "beside", "vehicles", "c-min", "seed"];
  const named = Object.keys(DEFAULTS).filter((key) => always.includes(key) || values[key] !== (key in STEPS[values.step].controls ? STEPS[values.step].controls[key] : DEFAULTS[key]));
  return `#${named.map((key) => `${key}=${values[key]}`).join("&")}`;
}
