// The tour: what a visitor sees first, and five steps, each a pair and what to look at: of cells, and at last of towns.

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
      + "a weak spot lasts. Press a vehicle to jam or free it.",
    controls: { imperfections: "standing" },
    jammed: [3],
  },
  {
    title: "An incident, and the way around it",
    text: "The same streets as a town with some 220 vehicles, sixty times as fast. For ten minutes an incident takes three quarters of a street’s capacity. Left nobody is told. Right three in ten "
      + "vehicles report their speed over this radio, and the half that follows advice drives around. What counts is that somebody reports from the street, and that drivers follow: "
      + "a few milliseconds more or less would not be felt. host-sim loop says how much each thing costs a trip.",
    controls: {},
    town: true,
  },
];
