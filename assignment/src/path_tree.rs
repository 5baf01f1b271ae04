//! Ways from one origin as a tree that grows from it: what they share at their beginning is kept once.
//!
//! The tree is a list of numbers. Links that follow each other stand side by side; where a run of links goes on from
//! another place than the end of the one before it, a mark in front of it says from where. Read backwards, every entry leads
//! to the origin, so that a way is one number: the position of its last link.

/// Position of the origin.
pub(crate) const ROOT: u32 = 0;

/// Marks an entry that is no link: the run behind it goes on from the position in its other bits.
const FORK: u32 = 1 << 31;

/// "Not there".
const NOWHERE: u32 = u32::MAX;

/// Ways from an origin, each given by the position of its last link.
#[derive(Debug, Clone)]
pub(crate) struct PathTree {
    /// By growing distance from the root: no entry leads to a later one.
    entries: Vec<u32>,
}

impl Default for PathTree {
    fn default() -> Self {
        Self {
            entries: vec![FORK | ROOT],
        }
    }
}

impl PathTree {
    /// Adds links, in the order of travel, to the way that ends at `from`; returns where the longer one ends.
    pub(crate) fn grow(&mut self, from: u32, links: impl IntoIterator<Item = u32>) -> u32 {
        if from != self.last() {
            self.entries.push(FORK | from);
        }
        self.entries.extend(links);
        self.last()
    }

    fn last(&self) -> u32 {
        (self.entries.len() - 1) as u32
    }

    /// One more than the last position.
    pub(crate) fn len(&self) -> usize {
        self.entries.len()
    }

    /// The links between two positions of a way, the last one first.
    #[inline]
    pub(crate) fn way(&self, end: u32, start: u32) -> Way<'_> {
        Way {
            entries: &self.entries,
            position: end,
            start,
        }
    }

    /// The links of the whole way in the order of travel.
    pub(crate) fn path(&self, end: u32) -> Box<[u32]> {
        let mut links: Box<[u32]> = self.way(end, ROOT).collect();
        links.reverse();
        links
    }

    /// Where two ways part.
    pub(crate) fn fork(&self, a: u32, b: u32) -> u32 {
        let (mut a, mut b) = (self.way(a, ROOT), self.way(b, ROOT));
        while a.position() != b.position() {
            // Whichever lies further back in the list is no part of the other.
            let further = if a.position() > b.position() {
                &mut a
            } else {
                &mut b
            };
            further.next();
        }
        a.position()
    }

    /// Calls `visit` with every link, its position and that of the link before it, from the root to the leaves.
    #[inline]
    pub(crate) fn for_each(&self, mut visit: impl FnMut(u32, u32, u32)) {
        let mut before = ROOT;
        for (position, &entry) in (1_u32..).zip(&self.entries[1..]) {
            if entry & FORK == 0 {
                visit(entry, position, before);
                before = position;
            } else {
                before = entry & !FORK;
            }
        }
    }

    /// Adds to the flow of every link those of the ways that use it. `flows` holds, by position, the flows of the ways that
    /// end there.
    pub(crate) fn load(&self, flows: &mut [f64], link_flows: &mut [f64]) {
        let mut carried = 0.0;
        for (position, &entry) in self.entries.iter().enumerate().skip(1).rev() {
            if entry & FORK == 0 {
                carried += flows[position];
                link_flows[entry as usize] += carried;
            } else {
                flows[(entry & !FORK) as usize] += carried;
                carried = 0.0;
            }
        }
    }

    /// Gives back the room that growing took in advance.
    pub(crate) fn shrink(&mut self) {
        self.entries.shrink_to_fit();
    }

    /// Keeps only the ways that end at one of `ends`, and moves these to their new positions. `moved` is room to work in.
    pub(crate) fn prune(&mut self, ends: &mut [u32], moved: &mut Vec<u32>) {
        moved.clear();
        moved.resize(self.entries.len(), NOWHERE);
        moved[ROOT as usize] = ROOT;
        for &end in ends.iter() {
            let mut way = self.way(end, ROOT);
            while moved[way.position() as usize] == NOWHERE {
                moved[way.position() as usize] = ROOT;
                way.next();
            }
        }
        let mut pruned = Self {
            entries: Vec::with_capacity(self.entries.len()),
        };
        pruned.entries.push(FORK | ROOT);
        self.for_each(|link, position, before| {
            if moved[position as usize] != NOWHERE {
                moved[position as usize] = pruned.grow(moved[before as usize], [link]);
            }
        });
        pruned.entries.shrink_to_fit();
        *self = pruned;
        for end in ends {
            *end = moved[*end as usize];
        }
    }
}

/// The links between two positions of a way, the last one first.
#[derive(Clone)]
pub(crate) struct Way<'t> {
    entries: &'t [u32],
    /// Of the next link, or of the mark that leads there.
    position: u32,
    start: u32,
}

impl Way<'_> {
    /// Where the rest of it ends.
    pub(crate) fn position(&self) -> u32 {
        let entry = self.entries[self.position as usize];
        if entry & FORK == 0 {
            self.position
        } else {
            entry & !FORK
        }
    }
}

impl Iterator for Way<'_> {
    type Item = u32;

    #[inline]
    fn next(&mut self) -> Option<u32> {
        while self.position != self.start {
            let entry = self.entries[self.position as usize];
            if entry & FORK == 0 {
                self.position -= 1;
                return Some(entry);
            }
            self.position = entry & !FORK;
        }
        None
    }
}
