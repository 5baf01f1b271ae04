// Colours: ages, kinds of use, lines. Those of the page itself are in style.css and follow the visitor's scheme.

// Cividis at every eighth of its range (Nuñez, Anderton, Renslow, PLOS ONE 2018): ordered by lightness, for colour-blind readers too.
const CIVIDIS = [
  [0, 34, 78], [26, 56, 111], [64, 77, 108], [94, 98, 110], [124, 123, 120],
  [155, 147, 118], [189, 174, 108], [223, 203, 89], [254, 232, 56],
];
const LARGEST_AGE = 100;

/** Share of the logarithmic scale from 1 to 100 ms. */
export const share = (age) => Math.min(Math.max(Math.log(age) / Math.log(LARGEST_AGE), 0), 1);

/** Colour of an age, and of writing upon it. */
export function ageColour(age) {
  const position = share(age) * (CIVIDIS.length - 1), below = Math.min(Math.floor(position), CIVIDIS.length - 2);
  const mix = CIVIDIS[below].map((from, i) => Math.round(from + (position - below) * (CIVIDIS[below + 1][i] - from)));
  return { fill: `rgb(${mix})`, ink: position > 4 ? "#000" : "#fff" };
}

/** How a policy's line is broken, so that lines differ without colour too. Its colour is `--policy-NAME` in style.css. */
export const DASHES = {
  actor: [], clock: [10, 3], central: [7, 4], "max-weight": [7, 4, 2, 4], assigned: [12, 4, 2, 4, 2, 4], grants: [4, 4], sps: [5, 2],
  "age-threshold": [2, 3], aloha: [9, 3, 2, 3], random: [1, 4], always: [3, 2],
};

/** The name in style.css of a policy's colour. */
export const policyColour = (policy) => `policy-${policy}`;

/** What became of a sub-channel: name, and share of the row's height, so that kinds differ without colour too. */
export const USES = {
  received: { name: "received", height: 1 },
  captured: { name: "several sent, the strongest received", height: 0.75 },
  collided: { name: "several sent, all lost", height: 0.5 },
  faded: { name: "one sent, lost in a fade", height: 0.25 },
  jammed: { name: "only jammed vehicles sent", height: 0.12 },
};

/** What stands behind a use: the place that the ring brings round is nobody's. */
export const OPEN = "nobody’s place, open to those who are called";

/** Which of them; null if nobody sent. The jammed are not on the air. */
export function kindOfUse({ senders, jammed, received }) {
  const onAir = senders - jammed;
  if (senders === 0) return null;
  if (onAir === 0) return "jammed";
  if (received !== null) return onAir === 1 ? "received" : "captured";
  return onAir === 1 ? "faded" : "collided";
}

const known = new Map();
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => known.clear());

/** The colour of this name in style.css, as the visitor's scheme has it now. */
export function colour(name) {
  if (!known.has(name)) known.set(name, getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim());
  return known.get(name);
}
