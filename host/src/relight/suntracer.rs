//! A thread that traces the sun while frames go on.

use super::sunplane::{means, trace};
use relume_firmware::field::Field;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::Builder;

/// A direction and room for its plane; the plane once it is traced.
type Plane = ([f32; 3], Vec<u16>);

/// The thread, as frames see it. It ends with this.
pub(super) struct SunTracer {
    orders: Sender<Plane>,
    traced: Receiver<Plane>,
    under_way: bool,
    ready: Option<Plane>,
    spare: Vec<u16>,
}

impl SunTracer {
    /// Starts a thread that waits for orders. It works alone, so that frames have the other cores.
    pub(super) fn start(field: Field<'static>) -> std::io::Result<Self> {
        let (orders, ordered) = channel::<Plane>();
        let (tell, traced) = channel();
        let work = move || {
            let mut means = means(&field);
            let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().ok();
            for (dir_world, mut plane) in ordered {
                super::install(pool.as_ref(), || trace(&field, dir_world, &mut means, &mut plane));
                if tell.send((dir_world, plane)).is_err() {
                    return;
                }
            }
        };
        Builder::new().name("sun".into()).spawn(work)?;
        let spare = vec![0; field.response().plane_len()];
        Ok(SunTracer { orders, traced, under_way: false, ready: None, spare })
    }

    /// Has a plane traced for this direction, unless one is under way.
    pub(super) fn ask(&mut self, dir_world: [f32; 3]) {
        if !self.under_way && self.ready.is_none() {
            self.under_way = self.orders.send((dir_world, std::mem::take(&mut self.spare))).is_ok();
        }
    }

    /// Is a plane under way?
    pub(super) fn is_tracing(&mut self) -> bool {
        self.ready_dir_world();
        self.under_way
    }

    /// Is a plane ready?
    pub(super) fn is_ready(&mut self) -> bool {
        self.ready_dir_world().is_some()
    }

    /// The direction of the plane that is ready.
    pub(super) fn ready_dir_world(&mut self) -> Option<[f32; 3]> {
        if self.under_way
            && let Ok(plane) = self.traced.try_recv()
        {
            self.ready = Some(plane);
            self.under_way = false;
        }
        self.known_dir_world()
    }

    /// The same as when it was last looked.
    pub(super) fn known_dir_world(&self) -> Option<[f32; 3]> {
        self.ready.as_ref().map(|(dir_world, _)| *dir_world)
    }

    /// Exchanges `plane` for the one that was last known to be ready.
    pub(super) fn take(&mut self, plane: &mut Vec<u16>) {
        if let Some((_, ready)) = self.ready.take() {
            self.spare = std::mem::replace(plane, ready);
        }
    }
}
