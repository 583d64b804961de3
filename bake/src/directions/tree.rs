//! The cuts with the least sum of errors for a number of patches.
//!
//! Where every patch costs `price` beside its error, the best cuts of a rectangle are those of its halves, or none: from the
//! finest rectangles upwards each is looked at once (D. Donoho, *CART and best-ortho-basis*, Annals of Statistics 25(5), 1997).
//! The price is the one that gives as many patches as are wanted, or just fewer; what is missing is cut where that gains most.

use super::boxes::{Boxes, Stretch};
use relume_firmware::patches::Cut;

/// Halvings of the price's range.
const STEPS: usize = 80;

const WHOLE: [Stretch; 2] = [Stretch(1), Stretch(1)];

/// Cuts of each zonal cell for `patches` in all, in the order of a set's layer.
pub(super) fn best_cuts(cells: &[Boxes], patches: usize) -> Vec<Cut> {
    let total: f64 = cells.iter().map(|cell| cell.error(WHOLE).abs()).sum();
    let at = |price: f64| cells.iter().map(|cell| Plan::new(cell, price)).collect::<Vec<_>>();
    let count = |plans: &[Plan<'_>]| plans.iter().map(|plan| plan.count(WHOLE)).sum::<usize>();
    // By powers of two: prices span many orders of magnitude. At the highest there is no cut.
    let (mut low, mut high) = (-60.0f64, 4.0f64);
    let mut best = at(total * high.exp2());
    for _ in 0..STEPS {
        let middle = 0.5 * (low + high);
        let plans = at(total * middle.exp2());
        if count(&plans) <= patches {
            (high, best) = (middle, plans);
        } else {
            low = middle;
        }
    }
    let mut missing = patches.saturating_sub(count(&best));
    while missing > 0 && cut_one_more(&mut best) {
        missing -= 1;
    }
    let mut cuts = Vec::with_capacity(2 * patches);
    best.iter().for_each(|plan| plan.write(WHOLE, &mut cuts));
    cuts
}

/// A cut that could be made.
struct Candidate {
    cell: usize,
    rectangle: [Stretch; 2],
    cut: Cut,
    gain: f64,
}

impl Candidate {
    fn cuts_before(&self) -> u8 {
        self.rectangle[0].cuts() + self.rectangle[1].cuts()
    }

    /// Gains it more, or the same for a larger patch?
    fn is_better_than(&self, other: &Candidate) -> bool {
        self.gain > other.gain || (self.gain == other.gain && self.cuts_before() < other.cuts_before())
    }
}

/// Cuts the patch whose cut gains most; `false` where none can be cut.
fn cut_one_more(plans: &mut [Plan<'_>]) -> bool {
    let mut best: Option<Candidate> = None;
    for (cell, plan) in plans.iter().enumerate() {
        plan.visit(WHOLE, &mut |rectangle, becomes| {
            let cuts = [Cut::Height, Cut::Azimuth].into_iter().filter(|_| becomes == Cut::Patch);
            for cut in cuts {
                let Some(halves) = plan.halves(rectangle, cut) else { continue };
                let after: f64 = halves.iter().map(|&half| plan.boxes.error(half)).sum();
                let found = Candidate { cell, rectangle, cut, gain: plan.boxes.error(rectangle) - after };
                if best.as_ref().is_none_or(|best| found.is_better_than(best)) {
                    best = Some(found);
                }
            }
        });
    }
    let Some(Candidate { cell, rectangle, cut, .. }) = best else { return false };
    let plan = &mut plans[cell];
    plan.cut(rectangle, cut);
    // The halves are patches, whatever would be best of them at the price.
    plan.halves(rectangle, cut).into_iter().flatten().for_each(|half| plan.cut(half, Cut::Patch));
    true
}

/// What becomes of each rectangle of a zonal cell.
struct Plan<'b> {
    boxes: &'b Boxes,
    cuts: Vec<Cut>,
}

impl<'b> Plan<'b> {
    fn new(boxes: &'b Boxes, price: f64) -> Self {
        let mut plan = Plan { boxes, cuts: vec![Cut::Patch; boxes.rows() * boxes.columns()] };
        let mut costs = vec![0.0; plan.cuts.len()];
        // Halves have larger numbers: they come first.
        for height in (1..boxes.rows()).rev() {
            for azimuth in (1..boxes.columns()).rev() {
                let rectangle = [Stretch(height), Stretch(azimuth)];
                let mut cost = boxes.error(rectangle) + price;
                for (axis, cut) in [Cut::Height, Cut::Azimuth].into_iter().enumerate() {
                    let Some(halves) = boxes.halves(rectangle, axis) else { continue };
                    let cut_cost = halves.map(|half| costs[boxes.index(half)]).iter().sum::<f64>();
                    if cut_cost < cost {
                        cost = cut_cost;
                        plan.cut(rectangle, cut);
                    }
                }
                costs[boxes.index(rectangle)] = cost;
            }
        }
        plan
    }

    fn cut(&mut self, rectangle: [Stretch; 2], cut: Cut) {
        let at = self.boxes.index(rectangle);
        self.cuts[at] = cut;
    }

    fn halves(&self, rectangle: [Stretch; 2], cut: Cut) -> Option<[[Stretch; 2]; 2]> {
        match cut {
            Cut::Patch => None,
            Cut::Height => self.boxes.halves(rectangle, 0),
            Cut::Azimuth => self.boxes.halves(rectangle, 1),
        }
    }

    /// Tells of a rectangle and all that it is cut into, in the order of a set's layer.
    fn visit(&self, rectangle: [Stretch; 2], tell: &mut impl FnMut([Stretch; 2], Cut)) {
        let cut = self.cuts[self.boxes.index(rectangle)];
        tell(rectangle, cut);
        for half in self.halves(rectangle, cut).into_iter().flatten() {
            self.visit(half, tell);
        }
    }

    fn count(&self, rectangle: [Stretch; 2]) -> usize {
        let mut patches = 0;
        self.visit(rectangle, &mut |_, cut| patches += usize::from(cut == Cut::Patch));
        patches
    }

    fn write(&self, rectangle: [Stretch; 2], cuts: &mut Vec<Cut>) {
        self.visit(rectangle, &mut |_, cut| cuts.push(cut));
    }
}
