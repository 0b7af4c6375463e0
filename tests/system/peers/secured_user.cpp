// A user's programs on Fast DDS with DDS Security, as the Debian package libfastrtps-dev brings it. No generated code: messages are
// taken and given as the bytes of their CDR.
//
// Usage: secured_user points NAMESPACE COUNT SECONDS | clock SECONDS_OF_CLOCK SECONDS
//
// points  takes COUNT messages of `corrected_point`, or as many as come within SECONDS: how many came.
// clock   publishes a time on /clock until /diagnostics carries it, or SECONDS have passed: whether it did.
//
// With ABBE_TEST_ENCLAVE, a folder of keys, it joins with security, and without one in the open. Domain: ROS_DOMAIN_ID. Prints one JSON object.

#include <chrono>
#include <cstdlib>
#include <cstring>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <iostream>
#include <string>
#include <thread>
#include <unistd.h>
#include <vector>

using namespace eprosima::fastdds::dds;
using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::SerializedPayload_t;

using Bytes = std::vector<unsigned char>;
using Clock = std::chrono::steady_clock;

// Any message, with the four bytes of its encapsulation.
class Raw : public TopicDataType {
public:
    explicit Raw(const char* name) {
        setName(name);
        m_typeSize = 65536;
        m_isGetKeyDefined = false;
    }
    bool serialize(void* data, SerializedPayload_t* payload) override {
        const auto& bytes = *static_cast<Bytes*>(data);
        std::memcpy(payload->data, bytes.data(), bytes.size());
        payload->encapsulation = CDR_LE;
        payload->length = bytes.size();
        return true;
    }
    bool deserialize(SerializedPayload_t* payload, void* data) override {
        static_cast<Bytes*>(data)->assign(payload->data, payload->data + payload->length);
        return true;
    }
    std::function<uint32_t()> getSerializedSizeProvider(void* data) override {
        return [data] { return static_cast<uint32_t>(static_cast<Bytes*>(data)->size()); };
    }
    void* createData() override { return new Bytes; }
    void deleteData(void* data) override { delete static_cast<Bytes*>(data); }
    bool getKey(void*, InstanceHandle_t*, bool) override { return false; }
};

static DomainParticipant* join() {
    DomainParticipantQos qos = PARTICIPANT_QOS_DEFAULT;
    qos.transport().use_builtin_transports = false;
    qos.transport().user_transports.push_back(
        std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>());
    if (const char* enclave = std::getenv("ABBE_TEST_ENCLAVE")) {
        auto& properties = qos.properties().properties();
        const auto file = [&](const std::string& name) { return "file://" + std::string(enclave) + "/" + name; };
        const std::string identity = "dds.sec.auth.builtin.PKI-DH.", access = "dds.sec.access.builtin.Access-Permissions.";
        properties.emplace_back("dds.sec.auth.plugin", "builtin.PKI-DH");
        properties.emplace_back("dds.sec.crypto.plugin", "builtin.AES-GCM-GMAC");
        properties.emplace_back("dds.sec.access.plugin", "builtin.Access-Permissions");
        properties.emplace_back(identity + "identity_ca", file("identity_ca.cert.pem"));
        properties.emplace_back(identity + "identity_certificate", file("cert.pem"));
        properties.emplace_back(identity + "private_key", file("key.pem"));
        properties.emplace_back(access + "permissions_ca", file("permissions_ca.cert.pem"));
        properties.emplace_back(access + "governance", file("governance.p7s"));
        properties.emplace_back(access + "permissions", file("permissions.p7s"));
    }
    const char* domain = std::getenv("ROS_DOMAIN_ID");
    return DomainParticipantFactory::get_instance()->create_participant(domain ? std::atoi(domain) : 0, qos);
}

static Topic* topic(DomainParticipant* participant, const std::string& name, const char* type) {
    TypeSupport support(new Raw(type));
    support.register_type(participant);
    return participant->create_topic(name, type, TOPIC_QOS_DEFAULT);
}

static DataReader* reader(DomainParticipant* participant, const std::string& name, const char* type) {
    DataReaderQos qos = DATAREADER_QOS_DEFAULT;
    qos.reliability().kind = BEST_EFFORT_RELIABILITY_QOS; // which is what is offered in a secured domain
    qos.history().depth = 1000;
    qos.endpoint().history_memory_policy = eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
    return participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT)
        ->create_datareader(topic(participant, name, type), qos);
}

// Calls `use` with each message until it says so, or the time is over.
template <typename Use> static void take(DataReader* from, double seconds, Use use) {
    const auto until = Clock::now() + std::chrono::duration<double>(seconds);
    Bytes message;
    SampleInfo info;
    while (Clock::now() < until) {
        while (from->take_next_sample(&message, &info) == ReturnCode_t::RETCODE_OK)
            if (info.valid_data && use(message)) return;
        if (use(Bytes())) return;
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
}

static int points(DomainParticipant* participant, const std::string& space, int count, double seconds) {
    int taken = 0;
    auto* from = reader(participant, "rt/" + space + "/corrected_point", "geometry_msgs::msg::dds_::PointStamped_");
    take(from, seconds, [&](const Bytes& message) {
        taken += !message.empty();
        return taken >= count;
    });
    std::cout << "{\"taken\": " << taken << "}" << std::endl;
    return 0;
}

static int clock(DomainParticipant* participant, int32_t time_s, double seconds) {
    DataWriterQos qos = DATAWRITER_QOS_DEFAULT;
    qos.durability().kind = VOLATILE_DURABILITY_QOS;
    qos.endpoint().history_memory_policy = eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
    auto* to = participant->create_publisher(PUBLISHER_QOS_DEFAULT)
                   ->create_datawriter(topic(participant, "rt/clock", "rosgraph_msgs::msg::dds_::Clock_"), qos);
    auto* from = reader(participant, "rt/diagnostics", "diagnostic_msgs::msg::dds_::DiagnosticArray_");
    Bytes now = {0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0};
    std::memcpy(now.data() + 4, &time_s, sizeof time_s);
    bool is_heard = false;
    auto told = Clock::now();
    take(from, seconds, [&](const Bytes& message) {
        if (Clock::now() - told > std::chrono::milliseconds(50)) {
            told = Clock::now();
            to->write(&now);
        }
        is_heard = message.size() > 8 && std::memcmp(message.data() + 4, &time_s, sizeof time_s) == 0;
        return is_heard;
    });
    std::cout << "{\"heard\": " << (is_heard ? "true" : "false") << "}" << std::endl;
    return 0;
}

int main(int count, char** words) {
    auto* participant = join();
    if (participant == nullptr) {
        std::cerr << "the keys are refused\n";
        return 1;
    }
    const std::string task = count > 1 ? words[1] : "";
    int code = 2;
    if (task == "points" && count == 5) code = points(participant, words[2], std::atoi(words[3]), std::atof(words[4]));
    if (task == "clock" && count == 4) code = clock(participant, std::atoi(words[2]), std::atof(words[3]));
    _exit(code); // Nothing of a test is left behind; the library takes seconds for its way out.
}
