//! System clock: 168 MHz from the board's 8 MHz crystal, or from the internal 16 MHz oscillator if that does not come up.
//!
//! # Source
//! RM0090, the STM32F405's reference manual: section 3.5.1 (flash wait states), chapter 7 (clocks of the STM32F405).

use cortex_m::peripheral::SCB;
use cortex_m_rt::exception;
use firmware::link::ClockSource;
use stm32f4::stm32f405::{FLASH, RCC, flash, rcc};

/// The internal oscillator, which runs at reset.
const HSI_HZ: u32 = 16_000_000;
/// The crystal.
const HSE_HZ: u32 = 8_000_000;
/// The PLL wants 1 to 2 MHz, and 2 MHz gives the least jitter.
const PLL_INPUT_HZ: u32 = 2_000_000;
/// 2 MHz x 168 = 336 MHz, which must be 100 to 432 MHz.
const PLL_N: u32 = 168;
/// 336 MHz / 2 = 168 MHz, the most that the core takes.
const PLL_P: u32 = 2;
/// 336 MHz / 7 = 48 MHz for USB; unused here, but the field must hold at least 2.
const PLL_Q: u32 = 7;
const PLL_HZ: u32 = PLL_INPUT_HZ * PLL_N / PLL_P;
/// 168 MHz / 2 = 84 MHz, the most that APB2 takes; APB1 takes half of it.
const APB2_DIVIDER: u32 = 2;

const _: () = assert!(PLL_HZ == 168_000_000 && PLL_HZ / APB2_DIVIDER <= 84_000_000);
const _: () = assert!(HSE_HZ.is_multiple_of(PLL_INPUT_HZ) && HSI_HZ.is_multiple_of(PLL_INPUT_HZ));

/// Reads of a flag before it counts as never coming. The slowest is the crystal, typically 2 ms by
/// the data sheet; a read takes at least 4 cycles, so this waits for at least 12 ms. It must end: an emulator and a board with a
/// dead crystal never set the flag, and a slow unit is better than none.
const POLLS: u32 = 50_000;

/// What the core runs from: the PLL, except for [`ClockSource::InternalSlow`], with every bus undivided, and [`ClockSource::Emulated`],
/// which says nothing: QEMU's core counts time as if it ran at 168 MHz, and its timers as if at 1 GHz.
#[derive(Clone, Copy)]
pub struct Clocks(pub ClockSource);

impl Clocks {
    /// Raises the clock as far as the hardware confirms.
    pub fn start(rcc: &RCC, flash: &FLASH) -> Self {
        // The oscillator that the core is running on at this moment says that it is not ready.
        if rcc.cr().read().hsirdy().bit_is_clear() {
            return Self(ClockSource::Emulated);
        }
        let start = |source, crystal: bool| {
            let raised = pll(rcc, crystal).is_some() && slow_flash(flash).is_some() && switch(rcc).is_some();
            if !raised {
                fall_back(rcc);
            }
            raised.then_some(source)
        };
        let source = start(ClockSource::Crystal, true).or_else(|| start(ClockSource::Internal, false));
        if let Some(ClockSource::Crystal) = source {
            // A crystal that dies from now on is an interrupt that cannot be masked (RM0090 section 7.2.7).
            rcc.cr().modify(|_, w| w.csson().set_bit());
        }
        Self(source.unwrap_or(ClockSource::InternalSlow))
    }

    /// The core's clock.
    pub const fn core_hz(self) -> u32 {
        match self.0 {
            ClockSource::Crystal | ClockSource::Internal | ClockSource::Emulated => PLL_HZ,
            ClockSource::InternalSlow => HSI_HZ,
        }
    }

    /// The clock of USART1.
    pub const fn apb2_hz(self) -> u32 {
        match self.0 {
            ClockSource::Crystal | ClockSource::Internal => PLL_HZ / APB2_DIVIDER,
            ClockSource::InternalSlow | ClockSource::Emulated => HSI_HZ,
        }
    }

    /// How many steps TIM2 counts in a microsecond. Timers of a divided bus run at twice its clock (RM0090 section 7.2):
    /// 84 MHz with the PLL.
    pub const fn timer_steps_per_microsecond(self) -> u32 {
        match self.0 {
            ClockSource::Crystal | ClockSource::Internal => PLL_HZ / 2 / 1_000_000,
            ClockSource::InternalSlow => HSI_HZ / 1_000_000,
            ClockSource::Emulated => 1_000,
        }
    }
}

/// The crystal has died: a start finds the internal oscillator.
#[exception]
#[allow(
    unsafe_code,
    reason = "an exception that critical sections do not hold back; it shares nothing"
)]
unsafe fn NonMaskableInt() -> ! {
    SCB::sys_reset()
}

fn pll(rcc: &RCC, crystal: bool) -> Option<()> {
    let input_hz = if crystal {
        rcc.cr().modify(|_, w| w.hseon().set_bit());
        poll(|| rcc.cr().read().hserdy().bit_is_set())?;
        HSE_HZ
    } else {
        HSI_HZ
    };
    // The regulator's scale 1, which 168 MHz needs, is its reset value (RM0090 section 5.4.1).
    rcc.pllcfgr().write(|w| {
        let w = w.pllsrc().bit(crystal).pllp().div2();
        // SAFETY: the divisors are inside the ranges of RM0090 section 7.3.2, and the PLL is off.
        #[allow(
            unsafe_code,
            reason = "the register description knows no ranges for these fields"
        )]
        unsafe {
            w.pllm()
                .bits((input_hz / PLL_INPUT_HZ) as u8)
                .plln()
                .bits(PLL_N as u16)
                .pllq()
                .bits(PLL_Q as u8)
        }
    });
    rcc.cr().modify(|_, w| w.pllon().set_bit());
    poll(|| rcc.cr().read().pllrdy().bit_is_set())
}

/// Five wait states for more than 150 MHz at 2.7 to 3.6 V (RM0090 table 10), hidden by prefetch and caches. The switch
/// must not happen before they read back.
fn slow_flash(flash: &FLASH) -> Option<()> {
    flash.acr().modify(|_, w| {
        w.latency()
            .ws5()
            .prften()
            .set_bit()
            .icen()
            .set_bit()
            .dcen()
            .set_bit()
    });
    poll(|| flash.acr().read().latency().variant() == flash::acr::LATENCY::Ws5)
}

fn switch(rcc: &RCC) -> Option<()> {
    rcc.cfgr()
        .modify(|_, w| w.hpre().div1().ppre1().div4().ppre2().div2().sw().pll());
    poll(|| rcc.cfgr().read().sws().variant() == Some(rcc::cfgr::SWSR::Pll))
}

/// Back to the reset state. The wait states stay: they only cost time.
fn fall_back(rcc: &RCC) {
    rcc.cfgr()
        .modify(|_, w| w.sw().hsi().hpre().div1().ppre1().div1().ppre2().div1());
    rcc.cr().modify(|_, w| w.pllon().clear_bit().hseon().clear_bit());
    // The PLL's divisors can be written once it has stopped.
    let _ = poll(|| rcc.cr().read().pllrdy().bit_is_clear());
}

fn poll(ready: impl Fn() -> bool) -> Option<()> {
    (0..POLLS).any(|_| ready()).then_some(())
}
