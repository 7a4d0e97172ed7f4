//! Who watches the threads: each of the daemon's has a name here, and one that ends unasked is either the
//! end of the daemon, in order, or reported on the page. Panics of threads and tasks that others start come in by
//! [`Supervision::panicked`].

use std::any::Any;
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use tokio::sync::watch;

use super::status::{Component, ComponentState};

/// Components that are listed: a defect that strikes with every request must not fill the memory.
const MAX_COMPONENTS: usize = 64;
/// A component that is to be broken is broken after this time.
const BREAK_AFTER: Duration = Duration::from_secs(2);

/// What it means when a component ends unasked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    /// Without it nothing is recorded or no one can see what happens: the daemon ends in order.
    Essential,
    /// The daemon goes on without it and says so.
    Dispensable,
    /// It ends by itself when its work is done.
    Passing,
}

thread_local! {
    static IS_WATCHED: Cell<bool> = const { Cell::new(false) };
}

/// All components of a daemon.
#[derive(Debug, Default)]
pub struct Supervision {
    components: Mutex<Vec<Component>>,
    /// The daemon ends: threads may return.
    is_ending: AtomicBool,
    /// The first essential component that died, and how.
    death: watch::Sender<Option<String>>,
    /// A component that panics after a while, to be tested with.
    to_be_broken: Option<String>,
}

/// A component's own view of its watch.
pub(super) struct Pulse<'a> {
    breaks_at: Option<Instant>,
    supervision: &'a Supervision,
}

impl Pulse<'_> {
    /// Once per turn of its loop.
    pub(crate) fn beat(&self) {
        let is_due = self.breaks_at.is_some_and(|at| Instant::now() >= at);
        if is_due && !self.supervision.is_ending() {
            panic!("ordered, as a test");
        }
    }
}

impl Supervision {
    /// No component yet; the component with this name will panic after two seconds, to be tested with.
    pub(crate) fn new(to_be_broken: Option<String>) -> Self {
        Self { to_be_broken, ..Self::default() }
    }

    /// Starts a thread under watch.
    pub(super) fn spawn(
        self: &Arc<Self>,
        name: &str,
        role: Role,
        work: impl FnOnce(&Pulse) + Send + 'static,
    ) -> std::io::Result<JoinHandle<()>> {
        let (supervision, watched) = (Arc::clone(self), name.to_owned());
        self.set(name, role, ComponentState::Running, None);
        // the system cuts names of threads off after 15 letters: the kind is enough there
        let kind = name.split(' ').next().unwrap_or(name).to_owned();
        let thread =
            std::thread::Builder::new().name(kind).spawn(move || supervision.run(&watched, role, work))?;
        Ok(thread)
    }

    fn run(&self, name: &str, role: Role, work: impl FnOnce(&Pulse)) {
        IS_WATCHED.set(true);
        let is_to_break = self.to_be_broken.as_deref() == Some(name);
        let pulse = Pulse { breaks_at: is_to_break.then(|| Instant::now() + BREAK_AFTER), supervision: self };
        // what it shares with others is behind locks that are usable after a panic
        let outcome = catch_unwind(AssertUnwindSafe(|| work(&pulse)));
        match outcome {
            Err(payload) => self.died(name, role, format!("it panicked: {}", words(&*payload))),
            Ok(()) if role != Role::Passing && !self.is_ending() => {
                self.died(name, role, "it ended without an order".into());
            }
            Ok(()) => self.set(name, role, ComponentState::Ended, None),
        }
    }

    /// A thread or task that is not under watch by name has panicked; from the panic hook.
    pub(crate) fn panicked(&self, thread: &str, what: &str) {
        if IS_WATCHED.get() {
            return; // whoever watches it says so
        }
        // receiving and flushing are threads of other modules, and recording stands on both
        let role =
            if matches!(thread, "receive" | "session-flush") { Role::Essential } else { Role::Dispensable };
        self.died(thread, role, format!("it panicked: {what}"));
    }

    /// From now on threads may end.
    pub(super) fn end(&self) {
        self.is_ending.store(true, Ordering::SeqCst);
    }

    fn is_ending(&self) -> bool {
        self.is_ending.load(Ordering::SeqCst)
    }

    /// Waits until an essential component dies: which, and how.
    pub(crate) async fn death(&self) -> String {
        let mut deaths = self.death.subscribe();
        match deaths.wait_for(Option::is_some).await {
            Ok(death) => death.clone().unwrap_or_default(),
            Err(_) => std::future::pending().await, // the sender lives as long as this
        }
    }

    /// What has died so far, in words.
    pub(super) fn deaths(&self) -> Vec<String> {
        let components = self.components();
        let dead = components.iter().filter(|component| component.state == ComponentState::Dead);
        dead.map(|component| format!("{}: {}", component.name, component.why.as_deref().unwrap_or("")))
            .collect()
    }

    /// Every component.
    pub(super) fn components(&self) -> Vec<Component> {
        self.lock().clone()
    }

    fn died(&self, name: &str, role: Role, why: String) {
        self.set(name, role, ComponentState::Dead, Some(why.clone()));
        if role == Role::Essential {
            self.death.send_if_modified(|death| {
                let is_first = death.is_none();
                death.get_or_insert(format!("{name}: {why}"));
                is_first
            });
        }
    }

    fn set(&self, name: &str, role: Role, state: ComponentState, why: Option<String>) {
        let mut components = self.lock();
        let essential = role == Role::Essential;
        if let Some(known) = components.iter_mut().find(|known| known.name == name) {
            (known.state, known.why) = (state, why);
        } else if components.len() < MAX_COMPONENTS {
            components.push(Component { name: name.to_owned(), essential, state, why });
        }
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Component>> {
        self.components.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What a panic says.
pub fn words(payload: &(dyn Any + Send)) -> &str {
    let text = payload.downcast_ref::<&str>().copied();
    text.or_else(|| payload.downcast_ref::<String>().map(String::as_str)).unwrap_or("without words")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn states(supervision: &Supervision) -> Vec<(String, ComponentState)> {
        supervision.components().into_iter().map(|component| (component.name, component.state)).collect()
    }

    #[test]
    fn an_end_without_an_order_is_a_death_and_an_ordered_one_is_none() {
        let supervision = Arc::new(Supervision::default());
        let spawn = |name, role, work: fn(&Pulse)| {
            supervision.spawn(name, role, work).unwrap().join().unwrap();
        };
        spawn("predict", Role::Passing, |_| {});
        spawn("live left", Role::Dispensable, |_| panic!("index out of bounds"));
        assert!(supervision.death.borrow().is_none(), "the daemon goes on without its picture");
        spawn("receive left", Role::Essential, |_| {});
        spawn("state", Role::Essential, |_| panic!("second"));
        assert_eq!(
            states(&supervision),
            [
                ("predict".to_owned(), ComponentState::Ended),
                ("live left".to_owned(), ComponentState::Dead),
                ("receive left".to_owned(), ComponentState::Dead),
                ("state".to_owned(), ComponentState::Dead)
            ]
        );
        assert_eq!(
            supervision.death.borrow().as_deref(),
            Some("receive left: it ended without an order"),
            "the first one is the cause"
        );
        assert_eq!(supervision.deaths()[0], "live left: it panicked: index out of bounds");
        supervision.end();
        spawn("recorder", Role::Essential, |_| {});
        assert_eq!(supervision.components().last().unwrap().state, ComponentState::Ended);
    }

    #[test]
    fn a_panic_of_an_unwatched_thread_is_reported_and_of_one_that_receives_is_the_end() {
        let supervision = Supervision::default();
        for _ in 0..1000 {
            supervision.panicked("tokio-rt-worker", "a handler");
        }
        assert_eq!(states(&supervision), [("tokio-rt-worker".to_owned(), ComponentState::Dead)]);
        assert!(supervision.death.borrow().is_none());
        supervision.panicked("receive", "a task");
        assert_eq!(supervision.death.borrow().as_deref(), Some("receive: it panicked: a task"));
    }

    #[test]
    fn a_component_breaks_when_it_is_to() {
        let supervision = Arc::new(Supervision::new(Some("state".into())));
        let thread = supervision.spawn("state", Role::Essential, |pulse| {
            loop {
                pulse.beat();
                std::thread::sleep(Duration::from_millis(5));
            }
        });
        thread.unwrap().join().unwrap();
        assert_eq!(states(&supervision), [("state".to_owned(), ComponentState::Dead)]);
    }
}
