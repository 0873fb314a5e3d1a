// SPDX-License-Identifier: BSD-3-Clause
//
// Masked camera frames of uvcam for C++17 and later, over uvcam.h.
//
//     uvcam::Subscriber left("left");
//     for (;;) {
//         left.wait(std::chrono::seconds(1));
//         while (auto frame = left.receive())
//             detect(frame->pixels(), frame->header().stride);
//     }
//
// Each operation comes twice: `receive()` throws uvcam::Error, `try_receive()` returns a uvcam::Expected, which holds the value or the
// Error. Without exceptions (-fno-exceptions) the first kind is absent.
//
// Threads: as in uvcam.h. A Subscriber may be moved to another thread, and is used by one at a time. A Frame or Mask may be read by several.
#ifndef UVCAM_HPP
#define UVCAM_HPP

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <variant>

#include "uvcam.h"

#if __has_include(<version>)
#include <version>
#endif
#ifdef __cpp_lib_span
#include <span>
#define UVCAM_LANGUAGE cxx20
#else
#define UVCAM_LANGUAGE cxx17
#endif

namespace uvcam {
// Translation units with and without std::span may meet in one program: their types have different names.
inline namespace UVCAM_LANGUAGE {

#ifdef __cpp_lib_span
template <class T> using Span = std::span<T>;
#else
/// What is used of std::span where there is none.
template <class T> class Span {
  public:
    using element_type = T;
    using value_type = std::remove_cv_t<T>;

    constexpr Span() noexcept = default;
    constexpr Span(T *data, std::size_t size) noexcept : data_(data), size_(size) {}

    constexpr T *data() const noexcept { return data_; }
    constexpr std::size_t size() const noexcept { return size_; }
    constexpr std::size_t size_bytes() const noexcept { return size_ * sizeof(T); }
    constexpr bool empty() const noexcept { return size_ == 0; }
    constexpr T &operator[](std::size_t at) const noexcept { return data_[at]; }
    constexpr T *begin() const noexcept { return data_; }
    constexpr T *end() const noexcept { return data_ + size_; }
    constexpr Span subspan(std::size_t offset, std::size_t count) const noexcept { return {data_ + offset, count}; }

  private:
    T *data_ = nullptr;
    std::size_t size_ = 0;
};
#endif

using Header = uvcam_frame_header;
using Health = uvcam_health;
using Counters = uvcam_counters;
/// 16 bytes.
using MaskId = std::array<std::uint8_t, 16>;

/// Why an operation failed: what is wrong, where, and what mends it.
class Error : public std::runtime_error {
  public:
    /// The failure of the call that this thread has just made.
    explicit Error(uvcam_status status) : std::runtime_error(uvcam_error_text()), status_(status) {}

    uvcam_status status() const noexcept { return status_; }

  private:
    uvcam_status status_;
};

/// A value, or the Error that there is instead.
template <class T> class [[nodiscard]] Expected {
  public:
    using value_type = T;
    using error_type = Error;

    Expected(T value) : held_(std::in_place_index<0>, std::move(value)) {}
    Expected(Error error) : held_(std::in_place_index<1>, std::move(error)) {}

    bool has_value() const noexcept { return held_.index() == 0; }
    explicit operator bool() const noexcept { return has_value(); }
    /// The value. Ends the program where there is none.
    T &operator*() & noexcept { return *checked(std::get_if<0>(&held_)); }
    const T &operator*() const & noexcept { return *checked(std::get_if<0>(&held_)); }
    T &&operator*() && noexcept { return std::move(*checked(std::get_if<0>(&held_))); }
    T *operator->() noexcept { return checked(std::get_if<0>(&held_)); }
    const T *operator->() const noexcept { return checked(std::get_if<0>(&held_)); }
    /// The error. Ends the program where there is none.
    const Error &error() const noexcept { return *checked(std::get_if<1>(&held_)); }
#ifdef __cpp_exceptions
    /// The value; throws the error where there is none.
    T value() && {
        if (!has_value())
            throw error();
        return std::move(**this);
    }
#endif

  private:
    template <class P> static P *checked(P *held) noexcept {
        if (held == nullptr)
            std::abort();
        return held;
    }

    std::variant<T, Error> held_;
};

/// Where the driver's services live: `prefix` and `root_path` of the table [ipc] of its configuration. Empty: the default.
struct Settings {
    std::string prefix = {};
    std::string root_path = {};
};

namespace detail {

/// A handle of uvcam.h, closed once.
template <class T, uvcam_status (*close)(T *)> class Handle {
  public:
    explicit Handle(T *handle) noexcept : handle_(handle) {}
    Handle(Handle &&other) noexcept : handle_(std::exchange(other.handle_, nullptr)) {}
    Handle &operator=(Handle &&other) noexcept {
        std::swap(handle_, other.handle_);
        return *this;
    }
    ~Handle() {
        if (handle_ != nullptr)
            close(handle_);
    }

    T *get() const noexcept { return handle_; }

  private:
    T *handle_;
};

/// Calls `open` with the settings as C has them.
template <class F> uvcam_status with(const Settings &settings, F open) {
    auto text = [](const std::string &text) { return text.empty() ? nullptr : text.c_str(); };
    const uvcam_settings given = {text(settings.prefix), text(settings.root_path)};
    return open(&given);
}

/// Milliseconds from zero to as many as there can be, never fewer than `time`.
template <class Rep, class Period> std::uint32_t milliseconds(std::chrono::duration<Rep, Period> time) noexcept {
    using Milliseconds = std::chrono::duration<long double, std::milli>;
    const long double count = Milliseconds(time).count();
    constexpr auto most = std::numeric_limits<std::uint32_t>::max();
    if (!(count > 0))
        return 0;
    if (count >= static_cast<long double>(most))
        return most;
    const auto whole = static_cast<std::uint32_t>(count);
    return static_cast<long double>(whole) < count ? whole + 1 : whole;
}

inline MaskId mask_id(const std::uint8_t (&bytes)[16]) noexcept {
    MaskId id;
    for (std::size_t at = 0; at < id.size(); ++at)
        id[at] = bytes[at];
    return id;
}

} // namespace detail

/// One frame, in the memory that the driver wrote. Gives it back when destroyed; may outlive its Subscriber.
class Frame {
  public:
    /// A checked copy, valid as long as this frame.
    const Header &header() const noexcept { return *view_.header; }
    /// The image: row by row from the top, header().stride bytes apart, to the last pixel of the last row.
    Span<const std::uint8_t> pixels() const noexcept { return {view_.pixels, view_.size}; }
    /// The pixels of row `y` without padding; empty where there is no such row.
    Span<const std::uint8_t> row(std::size_t y) const noexcept {
        if (y >= header().height)
            return {};
        return {view_.pixels + y * header().stride, view_.row_size};
    }
    std::size_t bytes_per_pixel() const noexcept { return view_.row_size / header().width; }
    /// Whether a mask was applied, so that what it masks is black.
    bool is_masked() const noexcept { return (header().flags & UVCAM_FLAG_MASKED) != 0; }
    MaskId mask_id() const noexcept { return detail::mask_id(header().mask_id); }
    /// CLOCK_MONOTONIC, which is std::chrono::steady_clock on Linux.
    std::chrono::steady_clock::time_point mid_exposure() const noexcept {
        return std::chrono::steady_clock::time_point(std::chrono::nanoseconds(header().mid_exposure_monotonic_ns));
    }
    /// Frames that the device produced since the frame before and that this consumer did not get.
    std::uint64_t lost_before() const noexcept { return view_.lost_before; }
    /// Whether driver or camera started anew since the frame before.
    bool epoch_changed() const noexcept { return view_.epoch_changed; }

  private:
    friend class Subscriber;

    uvcam_frame *get() const noexcept { return handle_.get(); }

    explicit Frame(uvcam_frame *frame) noexcept : handle_(frame) { uvcam_frame_read(frame, &view_); }

    detail::Handle<uvcam_frame, uvcam_frame_release> handle_;
    uvcam_frame_view view_ = {};
};

/// A mask that frames name. Gives its memory back when destroyed; may outlive its Frame and its Subscriber.
class Mask {
  public:
    MaskId id() const noexcept { return detail::mask_id(view_.mask_id); }
    std::uint32_t width() const noexcept { return view_.width; }
    std::uint32_t height() const noexcept { return view_.height; }
    /// The image, row by row from the top without padding, one byte a pixel: 0 discard, 255 keep. Grown where that was asked for.
    Span<const std::uint8_t> pixels() const noexcept { return {view_.pixels, view_.size}; }
    /// The masked runs in row order, from left to right, not grown.
    Span<const uvcam_run> runs() const noexcept { return {view_.runs, view_.run_count}; }
    /// Masked pixels, not grown.
    std::uint64_t masked_px() const noexcept { return view_.masked_px; }
    /// Where the mask comes from: a JSON object of texts.
    std::string_view provenance() const noexcept { return {view_.provenance, view_.provenance_size}; }

  private:
    friend class Subscriber;

    explicit Mask(uvcam_mask *mask) noexcept : handle_(mask) { uvcam_mask_read(mask, &view_); }

    detail::Handle<uvcam_mask, uvcam_mask_release> handle_;
    uvcam_mask_view view_ = {};
};

/// A consumer's end of one camera. The driver may come later, go, and come back.
class Subscriber {
  public:
    static Expected<Subscriber> try_open(const std::string &camera, const Settings &settings = {}) {
        uvcam_subscriber *subscriber = nullptr;
        const uvcam_status status = detail::with(
            settings, [&](const uvcam_settings *given) { return uvcam_open(camera.c_str(), given, &subscriber); });
        if (status < 0)
            return Error(status);
        return Subscriber(subscriber);
    }

    /// Whether a frame may be there; waits at most `timeout` for one.
    template <class Rep, class Period> Expected<bool> try_wait(std::chrono::duration<Rep, Period> timeout) {
        const uvcam_status status = uvcam_wait(handle_.get(), detail::milliseconds(timeout));
        if (status < 0)
            return Error(status);
        return status == UVCAM_OK;
    }

    /// The oldest unread frame, if there is one. Never waits.
    Expected<std::optional<Frame>> try_receive() { return take(uvcam_receive); }

    /// The newest unread frame, if there is one. Those before it are dropped, and do not count as lost.
    Expected<std::optional<Frame>> try_receive_latest() { return take(uvcam_receive_latest); }

    /// The mask of a frame, whichever is in force by now; none where its camera flies without. Masked areas reach `grown_by` pixels further
    /// to each side. Never waits: UVCAM_ERROR_MASK_PENDING where the mask has not come yet; go on with the next frame.
    Expected<std::optional<Mask>> try_mask_of(const Frame &frame, std::uint32_t grown_by = 0) {
        uvcam_mask *mask = nullptr;
        const uvcam_status status = uvcam_frame_mask(handle_.get(), frame.get(), grown_by, &mask);
        if (status < 0)
            return Error(status);
        return mask == nullptr ? std::nullopt : std::optional<Mask>(Mask(mask));
    }

    Expected<std::monostate> try_set_wakeup(uvcam_wakeup wakeup) {
        const uvcam_status status = uvcam_set_wakeup(handle_.get(), wakeup);
        if (status < 0)
            return Error(status);
        return std::monostate();
    }

    Expected<Counters> try_counters() const {
        Counters counters = {};
        const uvcam_status status = uvcam_get_counters(handle_.get(), &counters);
        if (status < 0)
            return Error(status);
        return counters;
    }

#ifdef __cpp_exceptions
    explicit Subscriber(const std::string &camera, const Settings &settings = {})
        : Subscriber(try_open(camera, settings).value()) {}
    template <class Rep, class Period> bool wait(std::chrono::duration<Rep, Period> timeout) {
        return try_wait(timeout).value();
    }
    std::optional<Frame> receive() { return try_receive().value(); }
    std::optional<Frame> receive_latest() { return try_receive_latest().value(); }
    std::optional<Mask> mask_of(const Frame &frame, std::uint32_t grown_by = 0) {
        return try_mask_of(frame, grown_by).value();
    }
    void set_wakeup(uvcam_wakeup wakeup) { try_set_wakeup(wakeup).value(); }
    Counters counters() const { return try_counters().value(); }
#endif

  private:
    explicit Subscriber(uvcam_subscriber *subscriber) noexcept : handle_(subscriber) {}

    Expected<std::optional<Frame>> take(uvcam_status (*receive)(uvcam_subscriber *, uvcam_frame **)) {
        uvcam_frame *frame = nullptr;
        const uvcam_status status = receive(handle_.get(), &frame);
        if (status < 0)
            return Error(status);
        return frame == nullptr ? std::nullopt : std::optional<Frame>(Frame(frame));
    }

    detail::Handle<uvcam_subscriber, uvcam_close> handle_;
};

/// A reader of one camera's health.
class HealthReader {
  public:
    /// Finds the driver of a camera, if one runs.
    static Expected<std::optional<HealthReader>> try_open(const std::string &camera, const Settings &settings = {}) {
        uvcam_health_reader *reader = nullptr;
        const uvcam_status status = detail::with(
            settings, [&](const uvcam_settings *given) { return uvcam_health_open(camera.c_str(), given, &reader); });
        if (status < 0)
            return Error(status);
        return reader == nullptr ? std::nullopt : std::optional<HealthReader>(HealthReader(reader));
    }

    /// The newest record that has not been read; waits at most `timeout` for it. None for three seconds: the driver is gone or stuck.
    template <class Rep, class Period>
    Expected<std::optional<Health>> try_read(std::chrono::duration<Rep, Period> timeout) {
        Health health = {};
        const uvcam_status status = uvcam_health_read(handle_.get(), detail::milliseconds(timeout), &health);
        if (status < 0)
            return Error(status);
        return status == UVCAM_OK ? std::optional<Health>(health) : std::nullopt;
    }

#ifdef __cpp_exceptions
    static std::optional<HealthReader> open(const std::string &camera, const Settings &settings = {}) {
        return try_open(camera, settings).value();
    }
    template <class Rep, class Period> std::optional<Health> read(std::chrono::duration<Rep, Period> timeout) {
        return try_read(timeout).value();
    }
#endif

  private:
    explicit HealthReader(uvcam_health_reader *reader) noexcept : handle_(reader) {}

    detail::Handle<uvcam_health_reader, uvcam_health_close> handle_;
};

} // namespace UVCAM_LANGUAGE
} // namespace uvcam

#undef UVCAM_LANGUAGE

#endif // UVCAM_HPP
