//! Random numbers of figures and scenes: the same everywhere for a seed.

/// PCG XSH RR 64/32 (O'Neill 2014).
#[derive(Clone, Debug)]
pub struct Random {
    state: u64,
    stream: u64,
}

impl Random {
    /// One of the streams of a seed, by its number (a pixel's, say).
    pub fn new(seed: u64, stream: u32) -> Self {
        let mut random = Random { state: seed, stream: (u64::from(stream) << 1) | 1 };
        random.bits();
        random.bits();
        random
    }

    /// 32 random bits.
    pub fn bits(&mut self) -> u32 {
        let old = self.state;
        self.state = old.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(self.stream);
        ((((old >> 18) ^ old) >> 27) as u32).rotate_right((old >> 59) as u32)
    }

    /// A number from 0 to below 1.
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 8) as f32 / (1u32 << 24) as f32
    }
}
