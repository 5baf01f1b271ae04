// The tour: what a visitor sees first, and four steps, each a pair of cells and what to look at.

export const STEPS = [
  {
    title: "The same second, twice",
    text: "Twenty vehicles report to one base station over three channels. Left everybody sends by chance, right a network of 3 KB decides in each vehicle: "
      + "the same vehicles, the same fading, in the same milliseconds. Yellow: the base station has heard nothing for 100 ms.",
    controls: {},
  },
  {
    title: "What is age?",
    text: "Five vehicles, a hundred times slower. A solid ray is a report that arrives: the number on its vehicle, the age of what the base station knows of it, "
      + "falls to 1 ms. A dashed ray is a report that is lost, and without a report an age grows by 1 ms in every slot. Dark is fresh, yellow is old.",
    controls: { vehicles: "5", speed: "1/100" },
  },
  {
    title: "Everybody talks",
    text: "Left every vehicle sends in every slot: the few that are near drown all others. Right each sends now and then, by lot, as ALOHA does: "
      + "now everybody is heard at times, but most reports still meet another one on their channel and are lost.",
    controls: { beside: "always", policy: "aloha", speed: "1/50" },
  },
  {
    title: "Taking turns",
    text: "The actor has its place in a ring that hands the channels round: three vehicles in every slot, all twenty within seven. Nobody tells it when to send; "
      + "each vehicle’s network decides from what it alone can sense. Left the lots again, with the same vehicles.",
    controls: { speed: "1/50" },
  },
  {
    title: "A car stands, one is jammed",
    text: "Vehicle 3, crossed out, is jammed: nothing that it sends arrives, its age only grows, and the others lose little. Three in ten now stand: where fading follows speed, "
      + "a weak spot lasts. Press a vehicle to jam or free it. What late knowledge costs a trip is the command line’s: host-sim loop.",
    controls: { imperfections: "standing" },
    jammed: [3],
  },
];
